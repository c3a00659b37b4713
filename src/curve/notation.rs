//! Numbers in messages: coordinates, lengths and times, readable in any unit.

use super::Point;

/// Significant digits of a coordinate at the scale of the scene.
const DIGITS: i32 = 6;

/// Powers of ten that are written in full. Other powers are written as a factor.
const PLAIN: std::ops::RangeInclusive<i32> = -4..=8;

/// Coordinates beyond this many extents of the scene have their own notation.
const FAR: f64 = 1e9;

/// Notation of coordinates: six significant digits at a scale, usually the extent of the scene.
///
/// All coordinates of a scene have the same number of decimals, so a coordinate that would be 0
/// without rounding errors is printed as 0. If the scale is below 10^-4, or at least 10^9, its
/// power of ten is written as a factor: `(1.23457, -0.50000, 0.00000) x 10^-9`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Notation {
    /// Power of ten that is written as a factor, or 0 for no factor.
    factor: i32,
    decimals: usize,
}

impl Notation {
    /// Returns the notation for coordinates at this scale. The scale 0 counts as 1.
    pub fn of(scale: f64) -> Notation {
        let power = match scale.abs() {
            x if x > 0.0 && x.is_finite() => power_of_ten(x),
            _ => 0,
        };
        let factor = if PLAIN.contains(&power) { 0 } else { power };
        let decimals = (DIGITS - 1 - (power - factor)).max(0) as usize;
        Notation { factor, decimals }
    }

    /// Returns the notation of a place in a scene of this extent. If the extent is unknown (0), or
    /// the place is far outside of the scene because a simulation diverged, the scale is the
    /// largest coordinate of the place.
    pub fn of_scene(extent: f64, place: Point) -> Notation {
        let largest = place.into_iter().fold(0.0, |a, x| x.abs().max(a));
        match largest < FAR * extent || largest == 0.0 {
            true => Notation::of(extent),
            false => Notation::of(largest),
        }
    }

    /// Returns a point as `(x, y, z)`.
    pub fn point(self, point: Point) -> String {
        let [x, y, z] = point.map(|x| self.mantissa(x));
        self.with_factor(format!("({x}, {y}, {z})"))
    }

    /// Returns a length with up to six significant digits. The power of ten is that of the
    /// coordinates, unless the length is much smaller.
    pub fn length(self, length: f64) -> String {
        let scaled = self.scaled(length);
        match PLAIN.contains(&power_of_ten(scaled)) {
            true => self.with_factor(significant(scaled)),
            false => significant(length),
        }
    }

    fn scaled(self, x: f64) -> f64 {
        // In two halves, since 10^308 is the largest finite power.
        let half = -self.factor / 2;
        x * 10f64.powi(half) * 10f64.powi(-self.factor - half)
    }

    fn mantissa(self, x: f64) -> String {
        let text = format!("{:.*}", self.decimals, self.scaled(x));
        match text.strip_prefix('-') {
            Some(zero) if zero.bytes().all(|b| matches!(b, b'0' | b'.')) => zero.to_owned(),
            _ => text,
        }
    }

    fn with_factor(self, text: String) -> String {
        match self.factor {
            0 => text,
            factor => format!("{text} x 10^{factor}"),
        }
    }
}

/// Returns a number with up to six significant digits.
pub(crate) fn significant(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{}", x + 0.0);
    }
    let notation = Notation::of(x);
    let text = notation.mantissa(x);
    let short = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    };
    notation.with_factor(short)
}

/// Returns the exponent of the number in decimal notation, rounded to the digits that are printed.
fn power_of_ten(x: f64) -> i32 {
    let text = format!("{x:.*e}", DIGITS as usize - 1);
    let exponent = text.rsplit('e').next();
    exponent.and_then(|e| e.parse().ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_have_six_significant_digits_of_the_scene() {
        let place = [1.234_567_89, -0.000_000_4, 0.0];
        for (extent, expected) in [
            (1.0, "(1.23457, 0.00000, 0.00000)"),
            (38.0, "(1.2346, 0.0000, 0.0000)"),
            (0.02, "(1.2345679, -0.0000004, 0.0000000)"),
            (1e5, "(1, 0, 0)"),
            (1e8, "(1, 0, 0)"),
            (9.999_999_9, "(1.2346, 0.0000, 0.0000)"),
        ] {
            assert_eq!(Notation::of(extent).point(place), expected, "{extent}");
        }
    }

    #[test]
    fn extreme_units_have_a_power_of_ten_as_a_factor() {
        for (unit, power) in [
            (1e-9, -9),
            (1e-5, -5),
            (1e12, 12),
            (1e200, 200),
            (1e-300, -300),
        ] {
            let place = [1.234_567_89 * unit, -2e-7 * unit, -0.5 * unit];
            let text = Notation::of(3.0 * unit).point(place);
            assert_eq!(text, format!("(1.23457, 0.00000, -0.50000) x 10^{power}"));
        }
        let tiny = f64::from_bits(3);
        let text = Notation::of(tiny).point([tiny, 0.0, -tiny]);
        assert_eq!(text, "(1.48220, 0.00000, -1.48220) x 10^-323");
    }

    #[test]
    fn lengths_have_the_power_of_ten_of_the_coordinates() {
        let nano = Notation::of(3e-9);
        assert_eq!(nano.length(7.020_41e-10), "0.702041 x 10^-9");
        assert_eq!(nano.length(2e-20), "2 x 10^-20");
        assert_eq!(nano.length(0.0), "0 x 10^-9");
        assert_eq!(Notation::of(40.0).length(0.003_932_1), "0.0039321");
    }

    #[test]
    fn a_place_far_outside_of_the_scene_has_its_own_notation() {
        let place = [0.012_345_678, 0.0, 0.0];
        let text = Notation::of_scene(0.0, place).point(place);
        assert_eq!(text, "(0.0123457, 0.0000000, 0.0000000)");
        let far = [6.915_656e23, -2e24, 0.0];
        let text = Notation::of_scene(10.0, far).point(far);
        assert_eq!(text, "(0.69157, -2.00000, 0.00000) x 10^24");
        let text = Notation::of_scene(0.0, [0.0; 3]).point([-0.0; 3]);
        assert_eq!(text, "(0.00000, 0.00000, 0.00000)");
    }

    #[test]
    fn lengths_and_times_have_up_to_six_significant_digits() {
        for (x, expected) in [
            (0.0, "0"),
            (-0.0, "0"),
            (2.263, "2.263"),
            (0.003_932_154_6, "0.00393215"),
            (0.28, "0.28"),
            (1234.5678, "1234.57"),
            (1e6, "1000000"),
            (123_456_789.0, "123456789"),
            (0.999_999_99, "1"),
            (1e-12, "1 x 10^-12"),
            (2.5e-9, "2.5 x 10^-9"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(significant(x), expected);
        }
    }
}
