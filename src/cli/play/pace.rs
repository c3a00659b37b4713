//! Pace at which recorded frames are published.

use crate::cli::number::positive;
use std::time::{Duration, Instant};

/// Parses the pace of the frames: a factor, or `max`, which is infinite.
pub fn speed(text: &str) -> Result<f64, String> {
    match text {
        "max" => Ok(f64::INFINITY),
        factor => positive(factor).map_err(|e| format!("{e}, or `max`")),
    }
}

/// Times at which frames are due.
pub struct Clock {
    /// Factor of the recorded pace.
    speed: f64,
    /// Time of the first frame: when it was published, and recorded in seconds.
    start: Option<(Instant, f64)>,
}

impl Clock {
    pub fn new(speed: f64) -> Clock {
        Clock { speed, start: None }
    }

    /// Returns the time at which a frame is due that was recorded at this time, in seconds. Frames
    /// whose time went backwards, or is not a number, are due now.
    pub fn due(&mut self, recorded: f64) -> Instant {
        let now = Instant::now();
        let (start, first) = *self.start.get_or_insert((now, recorded));
        let after = Duration::try_from_secs_f64((recorded - first) / self.speed);
        after.ok().and_then(|t| start.checked_add(t)).unwrap_or(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_due_at_a_factor_of_the_recorded_pace() {
        let mut clock = Clock::new(speed("4").unwrap());
        let start = clock.due(100.0);
        assert_eq!(clock.due(102.0), start + Duration::from_millis(500));
        assert_eq!(clock.due(101.0), start + Duration::from_millis(250));
        // Publishes at once if the clock of the recorder was set back, or if the time is not a
        // number.
        for recorded in [99.0, f64::NAN] {
            assert!(clock.due(recorded) <= Instant::now());
        }
        let mut clock = Clock::new(speed("max").unwrap());
        for recorded in [0.0, 1e9] {
            assert!(clock.due(recorded) <= Instant::now());
        }
    }

    #[test]
    fn a_speed_is_a_factor_above_0_or_max() {
        for bad in ["", "0", "-1", "nan", "inf", "fast"] {
            assert!(speed(bad).is_err(), "{bad}");
        }
    }
}
