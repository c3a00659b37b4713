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
#[cfg(feature = "bus")]
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
