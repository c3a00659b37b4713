//! Numbers with their nouns and units in messages, for the command and for reports of recordings.

#![cfg_attr(
    not(feature = "cli"),
    allow(dead_code, reason = "the command uses all")
)]

use std::time::Duration;

/// Whole numbers that are counts.
pub trait Count: std::fmt::Display {}

impl Count for u32 {}
impl Count for u64 {}
impl Count for usize {}

/// Formats a count with separators, `211,680`.
pub fn count(n: impl Count) -> String {
    let digits = n.to_string().into_bytes();
    let groups: Vec<&[u8]> = digits.rchunks(3).rev().collect();
    String::from_utf8(groups.join(&b',')).expect("digits and commas")
}

/// Formats a share from 0 to 1, `12.50 %`. Positive shares below 0.01 % are `under 0.01 %`, those
/// near all `over 99.99 %`.
pub fn percent(share: f64) -> String {
    match share * 100.0 {
        x if x > 0.0 && x < 0.01 => "under 0.01 %".to_owned(),
        x if x > 99.99 && x < 100.0 => "over 99.99 %".to_owned(),
        x => format!("{x:.2} %"),
    }
}

/// Formats a count with its noun, `1 link`, `2 links`.
pub fn plural(n: impl Count, noun: &str) -> String {
    plural_of(n, noun, &format!("{noun}s"))
}

/// Formats a count with its noun, `1 vertex`, `2 vertices`.
pub fn plural_of(n: impl Count, one: &str, many: &str) -> String {
    match count(n).as_str() {
        "1" => format!("1 {one}"),
        n => format!("{n} {many}"),
    }
}

/// Returns the result of `words`, or an empty text if the count is 0.
pub fn if_any(n: u64, words: impl FnOnce() -> String) -> String {
    if n > 0 { words() } else { String::new() }
}

/// Returns a duration as a number of milliseconds.
pub fn milliseconds(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

/// Formats a duration in milliseconds: two decimals below 10 ms, else none.
pub fn millis(d: Duration) -> String {
    let ms = milliseconds(d);
    let decimals = if ms < 10.0 { 2 } else { 0 };
    format!("{ms:.decimals$} ms")
}

/// Says that a recording ends at this byte, in this part of the file.
pub fn truncated(at: u64, what: &str) -> String {
    let at = count(at);
    format!(
        "the recording is truncated at byte {at}, in {what}: the recorder was stopped, or its disk \
         was full"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_have_separators() {
        assert_eq!(count(0_u64), "0");
        assert_eq!(count(999_u64), "999");
        assert_eq!(count(1000_u64), "1,000");
        assert_eq!(count(1_234_567_u64), "1,234,567");
        assert_eq!(percent(0.99999), "over 99.99 %");
        assert_eq!(percent(1.0), "100.00 %");
        assert_eq!(plural(1_u64, "link"), "1 link");
        assert_eq!(plural(2000_u64, "link"), "2,000 links");
        assert_eq!(millis(Duration::from_micros(1234)), "1.23 ms");
        assert_eq!(millis(Duration::from_millis(1234)), "1234 ms");
    }
}
