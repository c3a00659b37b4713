//! Numbers on the command line. The parser rejects NaN, infinities and numbers out of range.

use std::str::FromStr;
use std::time::Duration;

/// Parses a number that fulfils a condition, which `expected` names.
pub fn number<T: FromStr>(
    text: &str,
    expected: &str,
    fits: impl FnOnce(&T) -> bool,
) -> Result<T, String> {
    let parsed = text.parse().ok().filter(fits);
    parsed.ok_or_else(|| format!("expected {expected}"))
}

/// Parses a finite number that fulfils a condition, which `expected` names.
fn finite(text: &str, expected: &str, fits: impl FnOnce(f64) -> bool) -> Result<f64, String> {
    number(text, expected, |x: &f64| x.is_finite() && fits(*x))
}

/// Parses a number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    finite(text, "a number above 0", |x| x > 0.0)
}

/// Parses a number of at least 1.
pub fn one_or_more(text: &str) -> Result<f64, String> {
    finite(text, "a number of at least 1", |x| x >= 1.0)
}

/// Parses an integer of at least 1.
pub fn at_least_one(text: &str) -> Result<std::num::NonZeroU64, String> {
    number(text, "an integer of at least 1", |_| true)
}

/// Parses a number of at least 0.
pub fn not_negative(text: &str) -> Result<f64, String> {
    finite(text, "a number of at least 0", |x| x >= 0.0)
}

/// Parses a size in bytes: `1000000`, `500MB` or `2GiB`.
pub fn bytes(text: &str) -> Result<u64, String> {
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match text[number.len()..].to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1_048_576.0,
        "gib" => 1_073_741_824.0,
        "tib" => 1_099_511_627_776.0,
        _ => f64::NAN,
    };
    match number.trim_end().parse::<f64>() {
        // Numbers of bytes below 2^53 are exact.
        Ok(x) if (1.0..9e15).contains(&(x * factor)) => Ok((x * factor) as u64),
        _ => Err("expected a size, `500MB` or `2GiB` for example".into()),
    }
}

/// Parses a time in seconds.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let parsed = text.parse().map(Duration::try_from_secs_f64).ok();
    let time = parsed.and_then(Result::ok);
    time.ok_or_else(|| "expected seconds, a finite number of at least 0, and below 1.8e19".into())
}

/// Parses a share: `0.05` or `5%`.
pub fn share(text: &str) -> Result<f64, String> {
    let (share, unit) = match text.strip_suffix('%') {
        Some(share) => (share.trim_end(), 100.0),
        None => (text, 1.0),
    };
    let expected = "a number from 0 to 1, or from 0% to 100%";
    Ok(number(share, expected, |x: &f64| (0.0..=unit).contains(x))? / unit)
}

#[cfg(test)]
mod tests {
    #[test]
    fn sizes_have_decimal_and_binary_units() {
        for (text, expected) in [
            ("1000000", 1_000_000),
            ("500MB", 500_000_000),
            ("2GiB", 2 << 30),
            ("1.5 kib", 1536),
            ("7b", 7),
            ("0.5TB", 500_000_000_000),
        ] {
            assert_eq!(super::bytes(text), Ok(expected), "{text}");
        }
        for text in [
            "", "MB", "0", "-1MB", "nan", "inf", "1e99", "9999TB", "5 XB", "0.1",
        ] {
            assert!(super::bytes(text).is_err(), "{text}");
        }
    }
}
