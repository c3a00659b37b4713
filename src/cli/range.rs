//! The options `--from` and `--to`: frames by number or by simulation time.

use linkwatch::Result;
use std::fmt;
use std::mem::discriminant;

/// Number of a frame, or a simulation time.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub enum Bound {
    Seq(u64),
    /// Simulation time in seconds.
    Time(f64),
}

/// Parses the number of a frame, or a simulation time.
fn bound(text: &str) -> Result<Bound, &'static str> {
    let parsed = match text.strip_suffix('s') {
        Some(seconds) => seconds.trim_end().parse().ok().map(Bound::Time),
        None => text.parse().ok().map(Bound::Seq),
    };
    let valid = parsed.filter(|bound| !matches!(bound, Bound::Time(t) if !t.is_finite()));
    valid.ok_or("expected the number of a frame (28), or a simulation time in seconds (1.5s)")
}

impl Bound {
    /// Returns the number or the time of a frame, as this bound has one.
    fn at(self, seq: u64, time: f64) -> Bound {
        match self {
            Bound::Seq(_) => Bound::Seq(seq),
            Bound::Time(_) => Bound::Time(time),
        }
    }
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Bound::Seq(seq) => write!(f, "{seq}"),
            Bound::Time(time) => write!(f, "{time}s"),
        }
    }
}

/// Frames to replay.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct Range {
    /// Begin with this frame: its number, or a simulation time in seconds (`1.5s`)
    #[arg(long, value_name = "SEQ|TIME", allow_negative_numbers = true, value_parser = bound)]
    pub from: Option<Bound>,
    /// End with this frame: its number, or a simulation time in seconds (`2s`)
    #[arg(long, value_name = "SEQ|TIME", allow_negative_numbers = true, value_parser = bound)]
    pub to: Option<Bound>,
}

impl Range {
    /// Fails if the range is empty.
    pub fn check(&self) -> Result<()> {
        match (self.from, self.to) {
            (Some(from), Some(to)) if discriminant(&from) == discriminant(&to) && from > to => {
                Err(usage!("--from {from} is after --to {to}"))
            }
            _ => Ok(()),
        }
    }

    /// Returns true if a frame is before the range.
    pub fn is_after(&self, seq: u64, time: f64) -> bool {
        self.from.is_some_and(|from| from.at(seq, time) < from)
    }

    /// Returns true if a frame is after the range.
    pub fn is_before(&self, seq: u64, time: f64) -> bool {
        self.to.is_some_and(|to| to.at(seq, time) > to)
    }

    pub fn contains(&self, seq: u64, time: f64) -> bool {
        !self.is_after(seq, time) && !self.is_before(seq, time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_numbers_of_frames_or_times_in_seconds() {
        assert_eq!(bound("28"), Ok(Bound::Seq(28)));
        assert_eq!(bound("1.5s"), Ok(Bound::Time(1.5)));
        assert_eq!(bound("-2 s"), Ok(Bound::Time(-2.0)));
        for bad in ["", "s", "1.5", "-1", "nans", "infs", "1ms", "28f"] {
            assert!(bound(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_range_has_both_of_its_bounds() {
        let range = |from: &str, to: &str| Range {
            from: Some(bound(from).unwrap()),
            to: Some(bound(to).unwrap()),
        };
        let numbers = range("2", "4");
        assert_eq!(
            [1, 2, 4, 5].map(|n| numbers.contains(n, 0.0)),
            [false, true, true, false]
        );
        let mixed = range("0.5s", "4");
        assert!(mixed.contains(3, 0.5) && !mixed.contains(3, 0.4) && !mixed.contains(5, 1.0));
        assert!(range("4", "4").check().is_ok() && range("9", "1s").check().is_ok());
        let message = range("2s", "1s").check().unwrap_err().to_string();
        assert_eq!(message, "--from 2s is after --to 1s");
    }
}
