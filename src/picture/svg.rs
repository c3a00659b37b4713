//! Texts, numbers and ticks of SVG and HTML.

/// Returns a text without control characters and without characters that reorder the text around
/// them, of at most `most` characters. Texts of a recording may be hostile.
pub(crate) fn plain(text: &str, most: usize) -> String {
    let reorders = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let refused = |c: char| c.is_control() || reorders(c);
    let mut chars = text.chars();
    let start = chars.by_ref().take(most);
    let shown = start.map(|c| if refused(c) { '\u{fffd}' } else { c });
    let mut out: String = shown.collect();
    if chars.next().is_some() {
        out.push('\u{2026}');
    }
    out
}

/// Formats a coordinate in pixels with at most one decimal.
pub(crate) fn px(x: f64) -> String {
    let text = format!("{x:.1}");
    let short = text.strip_suffix(".0").unwrap_or(&text);
    if short == "-0" { "0" } else { short }.into()
}

/// Returns the largest of 1, 2 and 5 times a power of ten that is at most `x`, which is above 0.
pub(crate) fn round_below(x: f64) -> f64 {
    let power = 10f64.powi(x.log10().floor() as i32);
    let mut steps = [5.0, 2.0, 1.0].map(|step| step * power).into_iter();
    steps.find(|&s| s <= x * (1.0 + 1e-9)).unwrap_or(power)
}

/// Returns about `n` round numbers from 0 to `max`, at most 101.
pub(crate) fn ticks(max: f64, n: usize) -> Vec<f64> {
    if !(max > 0.0 && max.is_finite()) {
        return vec![0.0];
    }
    let step = round_below(max / n as f64).max(f64::MIN_POSITIVE);
    let are_too_many = max / step > 2.0 * n as f64;
    let step = if are_too_many { 2.0 * step } else { step };
    let last = (max / step * (1.0 + 1e-9)).floor().min(100.0) as usize;
    (0..=last).map(|k| k as f64 * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_have_no_control_characters() {
        let shown = plain("a\u{1b}[31m\u{202e}b\nc", 100);
        assert_eq!(shown, "a\u{fffd}[31m\u{fffd}b\u{fffd}c");
        assert_eq!(plain(&"ä".repeat(10), 3), "äää…");
        assert_eq!(plain("äää", 3), "äää");
    }

    #[test]
    fn numbers_are_short_and_round() {
        assert_eq!([1.0, -0.01, 12.34, -3.0].map(px), ["1", "0", "12.3", "-3"]);
        for (x, expected) in [
            (1.0, 1.0),
            (0.49, 0.2),
            (7.0, 5.0),
            (1e-9, 1e-9),
            (300.0, 200.0),
        ] {
            let found = round_below(x);
            assert!((found / expected - 1.0).abs() < 1e-9, "{x}: {found}");
        }
        assert_eq!(ticks(0.0, 4), [0.0]);
        assert_eq!(ticks(f64::NAN, 4), [0.0]);
        for max in [1.0, 3.0, 7.5, 12.0, 1e6, 1e-9, 1e300] {
            let ticks = ticks(max, 4);
            assert!((3..=10).contains(&ticks.len()), "{max}: {ticks:?}");
            assert!(*ticks.last().unwrap() <= max * 1.001);
        }
    }
}
