//! Gauss integrals in double-double arithmetic (Dekker 1971): the truth for the tests of bounds,
//! correct to about 28 digits.

use crate::curve::Point;
use crate::curve::vector::per_axis;
use crate::kernels::sums::interval::Interval;
use crate::kernels::{Chain, Estimate};
use crate::random::Random;

/// An unevaluated sum of two doubles.
#[derive(Clone, Copy, Debug)]
struct Double(f64, f64);

impl Double {
    fn of(a: f64, b: f64) -> Double {
        let sum = a + b;
        let c = sum - a;
        Double(sum, (a - (sum - c)) + (b - c))
    }

    fn plus(self, other: Double) -> Double {
        let Double(high, low) = Double::of(self.0, other.0);
        let Double(mid, rest) = Double::of(self.1, other.1);
        let Double(high, low) = Double::of(high, low + mid);
        Double::of(high, low + rest)
    }

    fn minus(self, other: Double) -> Double {
        self.plus(Double(-other.0, -other.1))
    }

    fn times(self, other: Double) -> Double {
        let high = self.0 * other.0;
        let low = self.0.mul_add(other.0, -high);
        Double::of(high, low + (self.0 * other.1 + self.1 * other.0))
    }

    fn root(self) -> Double {
        if self.0 <= 0.0 {
            return Double(0.0, 0.0);
        }
        let root = Double(self.0.sqrt(), 0.0);
        let rest = self.minus(root.times(root));
        Double::of(root.0, rest.0 / (2.0 * root.0))
    }

    /// Returns sine and cosine of a double from -4 to 4.
    fn sin_cos(x: f64) -> [Double; 2] {
        // Series for a 64th of the angle, which is then doubled six times.
        let small = Double(x / 64.0, 0.0);
        let square = small.times(small);
        let (mut sin, mut versine) = (Double(0.0, 0.0), Double(0.0, 0.0));
        // 1 - x^2/6 (1 - x^2/20 (..)) and x^2/2 (1 - x^2/12 (..)).
        let one = Double(1.0, 0.0);
        for k in (1..=12).rev() {
            let over = |product: f64, inner: Double| {
                let share = square.times(inner);
                let first = share.0 / product;
                let rest = share.minus(Double(first, 0.0).times(Double(product, 0.0)));
                Double::of(first, rest.0 / product)
            };
            let k = f64::from(k);
            sin = over((2.0 * k) * (2.0 * k + 1.0), one.minus(sin));
            versine = over((2.0 * k) * (2.0 * k - 1.0), one.minus(versine));
        }
        let mut sin = small.times(one.minus(sin));
        for _ in 0..6 {
            // sin 2x = 2 sin x (1 - v), v(2x) = 2 sin^2 x, for v = 1 - cos x.
            let next = sin.times(one.minus(versine));
            let square = sin.times(sin);
            sin = next.plus(next);
            versine = square.plus(square);
        }
        [sin, one.minus(versine)]
    }
}

type Vector = [Double; 3];

fn dot(a: Vector, b: Vector) -> Double {
    a[0].times(b[0])
        .plus(a[1].times(b[1]))
        .plus(a[2].times(b[2]))
}

fn cross(a: Vector, b: Vector) -> Vector {
    [(1, 2), (2, 0), (0, 1)].map(|(x, y)| a[x].times(b[y]).minus(a[y].times(b[x])))
}

/// Returns the argument of a complex number.
fn argument(x: Double, y: Double) -> Double {
    let near = y.0.atan2(x.0);
    let [s, c] = Double::sin_cos(near);
    let across = y.times(c).minus(x.times(s));
    let along = x.times(c).plus(y.times(s));
    Double::of(near, across.0 / along.0)
}

/// Returns the Gauss integral of two open polylines that do not touch.
fn integral(a: &[Point], b: &[Point]) -> Double {
    let mut sum = Double(0.0, 0.0);
    for k in a.windows(2) {
        for l in b.windows(2) {
            let sub = |p: Point, q: Point| -> Vector { per_axis(|x| Double::of(p[x], -q[x])) };
            let [a, b] = [sub(l[0], k[0]), sub(l[0], k[1])];
            let [c, d] = [sub(l[1], k[1]), sub(l[1], k[0])];
            for [a, b, c] in [[a, b, c], [c, d, a]] {
                let [na, nb, nc] = [a, b, c].map(|v| dot(v, v).root());
                let real = na.times(nb).times(nc).plus(dot(a, b).times(nc));
                let real = real.plus(dot(b, c).times(na)).plus(dot(c, a).times(nb));
                sum = sum.plus(argument(real, dot(a, cross(b, c))));
            }
        }
    }
    sum.times(Double(0.159_154_943_091_895_35, -9.839_338_337_591_243e-18))
}

fn holds(found: Interval, truth: Double) -> bool {
    let below = Double::of(truth.0, -found.lo).plus(Double(truth.1, 0.0));
    let above = Double::of(found.hi, -truth.0).minus(Double(truth.1, 0.0));
    below.0 >= 0.0 && above.0 >= 0.0
}

fn of_estimate(Estimate { value, bound }: Estimate) -> Interval {
    // Rounding inwards: the check is not weaker than the claim.
    Interval {
        lo: (value - bound).next_up(),
        hi: (value + bound).next_down(),
    }
}

fn check(a: Vec<Point>, b: Vec<Point>, truth: Double) -> f64 {
    let chains = [a, b].map(|points| Chain::new(points, false));
    let enclosed = chains[0].enclose(&chains[1]);
    assert!(holds(enclosed, truth), "{enclosed:?} {truth:?} {chains:?}");
    let found = chains[0].integral(&chains[1], 1e-9);
    assert!(
        holds(of_estimate(found), truth),
        "{found:?} {truth:?} {chains:?}"
    );
    enclosed.hi - enclosed.lo
}

#[test]
fn double_doubles_and_intervals_agree_with_fifty_digits() {
    for line in include_str!("values/gauss.csv").lines() {
        let fields: Vec<&str> = line.split(';').collect();
        let curve = |text: &str| -> Vec<Point> {
            let numbers: Vec<f64> = text.split(' ').map(|x| x.parse().unwrap()).collect();
            let point = |p: &[f64]| [p[0], p[1], p[2]].map(|x| x / 1024.0);
            numbers.chunks(3).map(point).collect()
        };
        let [a, b] = [curve(fields[0]), curve(fields[1])];
        let truth = Double(fields[2].parse().unwrap(), fields[3].parse().unwrap());
        let width = check(a.clone(), b.clone(), truth);
        // Curves that touch have no certain value.
        if width < 0.1 {
            let error = integral(&a, &b).minus(truth);
            assert!(error.0.abs() < 1e-28, "{line}: {error:?}");
        }
    }
}

/// Returns the median and the maximum of the widths of the intervals that are not undecided, and
/// the number of undecided ones.
fn random_pairs(seed: u64, count: usize) -> (f64, f64, usize) {
    let mut random = Random::new(seed);
    let mut widths = Vec::new();
    for k in 0..count {
        let scale = [1.0, 1e-3, 1e-9][k % 3];
        let mut curve = |first: Point, scale: f64| -> Vec<Point> {
            let n = 2 + random.below(6usize);
            (0..n)
                .map(|_| random.point(scale))
                .map(|p| per_axis(|x| first[x] + p[x]))
                .collect()
        };
        // Half of the pairs are small curves near each other and far from the origin.
        let first = if k % 2 == 0 {
            [0.0; 3]
        } else {
            [0.6, 0.3, -0.4]
        };
        let (mut a, b) = (curve(first, 0.4 * scale), curve(first, 0.4 * scale));
        if k % 5 == 0 {
            // A segment that passes another one at a very small distance.
            let [p, q] = [b[0], b[1]];
            let beside = per_axis(|x| 0.5 * (p[x] + q[x]) + 1e-6 * scale * (x as f64 - 0.7));
            let end = a[0];
            a.insert(1, per_axis(|x| beside[x] + (beside[x] - end[x])));
        }
        let truth = integral(&a, &b);
        widths.push(check(a, b, truth));
    }
    widths.sort_by(f64::total_cmp);
    let decided = widths.partition_point(|&w| w < 0.4);
    (widths[decided / 2], widths[decided - 1], count - decided)
}

#[test]
fn bounds_hold_the_true_integral_of_random_open_curves() {
    let (median, _, undecided) = random_pairs(10, 3000);
    assert!(median < 1e-11, "{median}");
    assert!(undecided < 300, "{undecided}");
}

#[test]
#[ignore = "takes a minute"]
fn bounds_hold_the_true_integral_of_random_open_curves_a_hundred_thousand_times() {
    let (median, most, undecided) = random_pairs(11, 100_000);
    println!("widths: median {median:.1e}, at most {most:.1e}; {undecided} undecided");
}
