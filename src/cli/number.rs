//! Numbers on the command line. The parser rejects NaN, infinities and numbers out of range.

#[cfg(feature = "bus")]
use std::time::Duration;

/// Parses a number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if f64::is_finite(x) && x > 0.0 => Ok(x),
        _ => Err("expected a number above 0".into()),
    }
}

/// Parses a number of segments, possibly written as `2e5`.
#[cfg(feature = "lab")]
pub fn segments(text: &str) -> Result<u64, String> {
    match text.parse::<f64>() {
        Ok(x) if (1.0..=f64::from(i32::MAX)).contains(&x) && x.fract() == 0.0 => Ok(x as u64),
        _ => Err(format!(
            "expected numbers of segments, from 1 to {}",
            i32::MAX
        )),
    }
}

/// Parses a time in seconds.
#[cfg(feature = "bus")]
pub fn seconds(text: &str) -> Result<Duration, String> {
    let time = text.parse().map(Duration::try_from_secs_f64);
    match time {
        Ok(Ok(time)) => Ok(time),
        _ => Err("expected seconds, a finite number of at least 0".into()),
    }
}

/// Parses a share: `0.05` or `5%`.
pub fn share(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.strip_suffix('%') {
        Some(number) => (number.trim_end(), 100.0),
        None => (text, 1.0),
    };
    match number.parse::<f64>() {
        Ok(x) if (0.0..=unit).contains(&x) => Ok(x / unit),
        _ => Err("expected a number from 0 to 1, or from 0% to 100%".into()),
    }
}

#[cfg(all(test, feature = "lab"))]
mod tests {
    use super::segments;

    #[test]
    fn numbers_of_segments_are_whole_and_in_range() {
        assert_eq!(segments("2e5"), Ok(200_000));
        let bad = ["0", "-1", "nan", "1.5", "", "1e99"];
        assert!(bad.iter().all(|s| segments(s).is_err()));
    }
}
