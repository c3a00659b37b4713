//! Cause of a pull-through: how far and how fast the strands moved, and the time step that would
//! have kept them apart.
//!
//! # Derivation
//!
//! Between two frames, `T` seconds apart, every point moves on a straight line at constant speed
//! (the assumption of all pull-throughs): at time `t` its place is `x0 + (t / T) (x1 - x0)`. Two
//! strands meet at the share `f` of this step, so at time `f T`. Their relative motion in the whole
//! step is `d = |(q1 - q0) - (p1 - p0)|`, where `p` and `q` are the points that meet, so their
//! relative speed is `d / T`.
//!
//! A simulator that starts at the same frame and ends its step at `h < f T`, at the same speed, is
//! on the same straight lines, before the strands meet. So its frame after this step is intact, if
//! this is the first pull-through of the step: the largest such step is `f T`. What happens in the
//! step after that depends on the forces between the strands, which such a step gives a chance to
//! act.
//!
//! If the simulator made several steps between the frames, the strands met after `f T / h` of them
//! by the same assumption. If that is more than one, its step was not too long to see the strands
//! before they met.

use crate::curve::vector::{add, distance, dot, half_difference, hypot, mix, sub};
use crate::curve::{Cell, CurveSet, Point, significant};
use crate::verdict::PullThrough;
use serde::Serialize;

/// Number of parts in which the point of a spline segment is searched, and the number of times that
/// the best part is divided again.
const PARTS: usize = 16;
const REFINEMENTS: usize = 8;

/// Motion of the strands of a pull-through between two frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Cause {
    /// Motion of one strand relative to the other one at the place where they met, in the units of
    /// the simulation.
    pub distance: f64,
    /// The same, in lengths of the longer segment ([`PullThrough::lengths`]). 0 if they passed
    /// through one another at a contact in a frame.
    pub lengths: f64,
    /// Time between the frames, in seconds; `None` if it is unknown.
    pub interval: Option<f64>,
    /// Relative speed, in the units of the simulation per second.
    pub speed: Option<f64>,
    /// Time from the first frame until the strands met, in seconds. A time step below it, from the
    /// first frame and at this speed, would have ended before they met.
    pub until: Option<f64>,
    /// Time step of the simulator, in seconds; `None` if it is unknown.
    pub time_step: Option<f64>,
    /// Number of time steps of the simulator between the frames.
    pub steps: Option<f64>,
    /// Share of the time between the frames until the strands met.
    fraction: f64,
}

impl Cause {
    /// Returns the motion of a pull-through between two frames of the same curves, `interval`
    /// seconds apart. `cells` are their periodic cells, if they have some. `time_step` is that of
    /// the simulator. Both times are 0 if they are unknown.
    ///
    /// # Panics
    ///
    /// # Panics
    ///
    /// If the frames do not have the curves and segments of the pull-through.
    pub fn of(
        passage: &PullThrough,
        frames: [&CurveSet; 2],
        cells: [Option<Cell>; 2],
        (interval, time_step): (f64, f64),
    ) -> Cause {
        let known = |seconds: f64| (seconds > 0.0 && seconds.is_finite()).then_some(seconds);
        let (interval, time_step) = (known(interval), known(time_step));
        let by = cells.map(|cell| cell.map_or([0.0; 3], |c| c.translation(passage.image)));
        let [s, t] = passage.segments;
        let ends = [(passage.i, s, [[0.0; 3]; 2]), (passage.j, t, by)];
        let ends = ends.map(|(curve, segment, by)| {
            let frames = [(frames[0], by[0]), (frames[1], by[1])];
            meeting_points(passage, frames, curve, segment)
        });
        let apart = |frame: usize| half_difference(ends[1][frame], ends[0][frame]);
        let distance = 2.0 * hypot(sub(apart(1), apart(0)));
        Cause {
            distance,
            lengths: passage.lengths,
            interval,
            speed: interval.map(|t| distance / t),
            until: interval.map(|t| passage.fraction * t),
            time_step,
            steps: interval.zip(time_step).map(|(t, h)| t / h),
            fraction: passage.fraction,
        }
    }

    /// Returns a sentence about the motion. `frames` are the numbers of both frames.
    pub fn motion(&self, [from, to]: [u64; 2]) -> String {
        if self.lengths == 0.0 {
            return "the strands touched in a frame before they went on to the other side".into();
        }
        let mut motion = format!(
            "from frame {from} to {to} the strands moved {} relative to one another, {} segment \
             lengths",
            significant(rounded(self.distance)),
            significant(rounded(self.lengths)),
        );
        if let (Some(interval), Some(speed), Some(until)) = (self.interval, self.speed, self.until)
        {
            motion += &format!(
                ", in {} s: {} a second; they met after {} s",
                significant(rounded(interval)),
                significant(rounded(speed)),
                significant(rounded(until)),
            );
        }
        motion
    }

    /// Returns a sentence about the time step, if this is the first pull-through of the step from
    /// frame `from` on. `safe_fraction` is the proven share of the step in which nothing was pulled
    /// through ([`Report::safe_fraction`](crate::Report::safe_fraction)), if it is known.
    ///
    /// The advice is for the motion between these frames, at its speed: forces between the strands
    /// would have to stop them in the steps after that.
    pub fn advice(&self, from: u64, safe_fraction: Option<f64>) -> String {
        if self.lengths == 0.0 {
            return "no time step follows from a passage through a contact in a frame".into();
        }
        // Proven for all curves, and just below the first pull-through.
        let share = safe_fraction.map_or(self.fraction, |safe| safe.min(self.fraction));
        let percent = format!("{:.1} %", (1e3 * share).floor() / 10.0);
        match (self.interval, self.time_step, self.steps) {
            (Some(interval), Some(step), Some(steps)) if share * interval > step => format!(
                "frames are {} time steps of {} s apart, and the strands met after about {}: the \
                 time step alone is not the cause; publish every step to see more",
                significant(rounded(steps)),
                significant(rounded(step)),
                significant(rounded(share * interval / step)),
            ),
            (Some(interval), step, _) => {
                let limit = significant(rounded_down(share * interval));
                let known = match step {
                    Some(step) => format!("it was {} s", significant(rounded(step))),
                    None => "it is unknown, and may be less already".into(),
                };
                format!(
                    "a time step of at most {limit} s from frame {from} on, {percent} of the time \
                     between the frames, would have kept all strands apart at this speed; {known}"
                )
            }
            (None, ..) => format!(
                "a step of at most {percent} of this one would have kept all strands apart at this \
                 speed; the frames have no time"
            ),
        }
    }
}

/// Returns the point of a segment that meets the other strand, in both frames. The curves of each
/// are translated.
fn meeting_points(
    passage: &PullThrough,
    frames: [(&CurveSet, Point); 2],
    curve: u32,
    segment: u32,
) -> [Point; 2] {
    let (i, s) = (curve as usize, segment as usize);
    let at = |t: f64| {
        frames.map(|(set, by)| {
            let point = match set.basis().is_polyline() {
                true => mix(set.knot(i, s), set.knot(i, s + 1), t),
                false => set.eval(i, s, t),
            };
            add(point, by)
        })
    };
    let then = |t: f64| {
        let [before, after] = at(t);
        mix(before, after, passage.fraction)
    };
    if frames[0].0.basis().is_polyline() {
        let (a, b) = (then(0.0), then(1.0));
        let (way, to) = (sub(b, a), sub(passage.point, a));
        let t = dot(way, to) / dot(way, way);
        // A segment without a length has one point.
        return at(if t.is_finite() {
            t.clamp(0.0, 1.0)
        } else {
            0.0
        });
    }
    let (mut low, mut high) = (0.0, 1.0);
    let mut best = 0.5;
    for _ in 0..REFINEMENTS {
        let part = (high - low) / PARTS as f64;
        let candidates = (0..=PARTS).map(|k| low + part * k as f64);
        let off = |t: f64| distance(then(t), passage.point);
        best = candidates.fold(low, |best, t| if off(t) < off(best) { t } else { best });
        (low, high) = ((best - part).max(0.0), (best + part).min(1.0));
    }
    at(best)
}

/// Rounds to three significant digits.
fn rounded(x: f64) -> f64 {
    let text = format!("{x:.2e}");
    text.parse().unwrap_or(x)
}

/// Rounds a positive number down to three significant digits.
fn rounded_down(x: f64) -> f64 {
    let nearest = rounded(x);
    match nearest > x {
        true => rounded(nearest - 0.01 * 10f64.powi(x.log10().floor() as i32)),
        false => nearest,
    }
}

#[cfg(test)]
mod tests {
    use super::super::ledger::tests::planted::{Plant, planted_step};
    use super::super::{Coverage, Ledger};
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::random::Random;

    const COVERAGE: Coverage = Coverage {
        open_curves: true,
        self_crossings: true,
    };

    /// The motion of a planted passage is known: both of its segments move as a whole.
    #[test]
    fn motions_are_those_of_planted_pull_throughs() {
        let mut ledger = Ledger::default();
        ledger.motion_limit = f64::INFINITY;
        for basis in [Basis::Polyline, Basis::Bezier] {
            let mut r = Random::new(31);
            let mut done = 0;
            while done < 100 {
                let plant = r.pick(&[Plant::Single, Plant::SelfCrossing, Plant::Open]);
                let Some(planted) = planted_step(&mut r, basis, plant) else {
                    continue;
                };
                let [before, after] = &planted.frames;
                let outcome = ledger.first_step(before, after, COVERAGE, None);
                for event in &outcome.events {
                    done += 1;
                    let moved = |curve: u32, segment: u32| {
                        let [p, q] = [before, after]
                            .map(|set| set.eval(curve as usize, segment as usize, 0.5));
                        sub(q, p)
                    };
                    let [s, t] = event.segments;
                    let expected = distance(moved(event.i, s), moved(event.j, t));
                    let cause = Cause::of(event, [before, after], [None; 2], (0.25, 0.0));
                    let error = (cause.distance - expected).abs();
                    assert!(error < 1e-6 * expected, "{cause:?}, expected {expected}");
                    assert_eq!(cause.speed, Some(cause.distance / 0.25));
                    assert_eq!(cause.until, Some(0.25 * event.fraction));
                }
            }
        }
    }

    /// The same motion at the same speed with the proposed step gives an intact first frame, and
    /// with a longer one it does not.
    #[test]
    fn a_step_just_below_the_limit_ends_before_the_pull_through_and_one_above_does_not() {
        let mut ledger = Ledger::default();
        ledger.motion_limit = f64::INFINITY;
        let mut r = Random::new(77);
        let mut done = 0;
        while done < 200 {
            let plant = r.pick(&[
                Plant::Single,
                Plant::Cancelling,
                Plant::SelfCrossing,
                Plant::Open,
            ]);
            let Some(planted) = planted_step(&mut r, Basis::Polyline, plant) else {
                continue;
            };
            let [before, after] = &planted.frames;
            let outcome = ledger.first_step(before, after, COVERAGE, None);
            let Some(first) = outcome.events.first() else {
                continue;
            };
            done += 1;
            let interval = 0.004;
            let until = Cause::of(first, [before, after], [None; 2], (interval, interval))
                .until
                .unwrap();
            for (step, passes) in [(0.9999 * until, false), (1.0001 * until, true)] {
                let at = before.toward(after, step / interval).unwrap();
                let outcome = ledger.first_step(before, &at, COVERAGE, None);
                assert_eq!(!outcome.events.is_empty(), passes, "{plant:?}: {first:?}");
            }
        }
    }

    /// Two crossed strands: one moves by 2 from above the other one to below it. They meet at
    /// 25.535 % of the step.
    fn crossed(scale: f64) -> ([CurveSet; 2], PullThrough) {
        let frames = [0.5107, -1.4893].map(|z| {
            let xyz = [-1.0, 0.0, z, 1.0, 0.0, z, 0.0, -2.0, 0.0, 0.0, 2.0, 0.0];
            let xyz = xyz.map(|x: f64| scale * x);
            CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&xyz)).unwrap()
        });
        let [before, after] = &frames;
        let outcome = Ledger::default().first_step(before, after, COVERAGE, None);
        assert_eq!(outcome.events.len(), 1);
        let event = outcome.events[0];
        (frames, event)
    }

    #[test]
    fn names_the_time_step_that_would_have_kept_the_strands_apart() {
        let ([before, after], event) = crossed(0.006);
        let cause = |times| Cause::of(&event, [&before, &after], [None; 2], times);
        let every_step = cause((0.004, 0.004));
        assert!((every_step.distance - 0.012).abs() < 1e-15);
        assert_eq!(
            every_step.motion([27, 28]),
            "from frame 27 to 28 the strands moved 0.012 relative to one another, 0.5 segment \
             lengths, in 0.004 s: 3 a second; they met after 0.00102 s"
        );
        assert_eq!(
            every_step.advice(27, None),
            "a time step of at most 0.00102 s from frame 27 on, 25.5 % of the time between the \
             frames, would have kept all strands apart at this speed; it was 0.004 s"
        );
        assert_eq!(
            cause((0.004, 0.0005)).advice(27, Some(0.2499)),
            "frames are 8 time steps of 0.0005 s apart, and the strands met after about 2: the \
             time step alone is not the cause; publish every step to see more"
        );
        let without_times = cause((0.0, 0.0));
        let motion = without_times.motion([3, 4]);
        assert!(motion.ends_with("0.5 segment lengths"), "{motion}");
        let advice = without_times.advice(3, Some(0.2499));
        assert!(
            advice.starts_with("a step of at most 24.9 % of this one"),
            "{advice}"
        );
    }

    #[test]
    fn motions_do_not_overflow() {
        for scale in [1e150, 1e-150] {
            let ([before, after], event) = crossed(scale);
            let cause = Cause::of(&event, [&before, &after], [None; 2], (1.0, 1.0));
            assert!(
                (cause.distance / (2.0 * scale) - 1.0).abs() < 1e-12,
                "{cause:?}"
            );
        }
    }

    #[test]
    fn time_steps_are_rounded_down() {
        for (x, expected) in [
            (0.0017196, 0.00171),
            (0.00999, 0.00999),
            (12.0, 12.0),
            (9.999, 9.99),
        ] {
            assert_eq!(rounded_down(x), expected);
        }
    }
}
