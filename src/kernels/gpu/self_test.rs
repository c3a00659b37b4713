//! Test of the arithmetic of an adapter, run once when it is opened: it must satisfy the
//! assumptions of the error bounds.
//!
//! A sample is no proof. It finds what a driver gets wrong in general: operations that are
//! approximated too coarsely, terms that are regrouped in spite of pinning, wrong conversions and
//! carries.

use super::State;
use super::commands::{Binding, Buffer, Command, Stage};
use super::error::Error;
use super::fixed;
use super::layout::Parameters;
use super::precision::Real;

/// Returns the shader that computes the samples.
pub(super) fn stage<R: Real>() -> Stage {
    Stage {
        name: R::SELF_TEST,
        source: || super::shader::<R>(&[], &[], &[include_str!("self_test.wgsl")]),
    }
}

const OPERANDS: Buffer = Buffer("operands", "self test");
const RESULTS: Buffer = Buffer("results", "self test");
const HALVES: Buffer = Buffer("halves", "self test");

/// Returns the samples: all kinds of mantissas, within the range of the kernels.
fn operands<R: Real>() -> Vec<[R; 2]> {
    let mut state = 0x2545_f491_4f6c_dd1du64;
    let mut next = |spread: i32| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let mantissa = 1.0 + (state >> 12) as f64 * f64::EPSILON;
        let exponent = (state >> 8 & 0xff) as i32 % spread;
        let sign = if state & 1 == 0 { 1.0 } else { -1.0 };
        R::nearest(sign * mantissa * 2f64.powi(-exponent))
    };
    let mut out: Vec<[R; 2]> = (0..4096).map(|k| [next(20), next(1 + k % 40)]).collect();
    // Sums of fixed-point numbers reach a magnitude of 2^10.
    out.extend((0..1024).map(|k| {
        let large = next(1).into() * f64::from(1 << (k % 9));
        [R::nearest(large), next(20)]
    }));
    // Neighbouring numbers: their differences are exact on every usable adapter.
    let x = R::nearest(1.0 / 3.0);
    for k in 0..64 {
        let places = f64::from(k) * R::UNIT_ERROR / 4.0;
        out.push([x, R::nearest(x.into() + places)]);
    }
    out
}

/// Runs the shader and compares its results.
pub(super) fn run<R: Real>(state: &mut State) -> Result<(), Error> {
    let operands = operands::<R>();
    let n = operands.len() as u64;
    let parameters = Parameters::new(0.0, 0, n as u32);
    let real = size_of::<R>() as u64;
    let sizes = [2 * real * n, 8 * real * n, 16 * n];
    let commands = [
        Command::Upload(super::PARAMETERS, bytemuck::bytes_of(&parameters).to_vec()),
        Command::Upload(OPERANDS, bytemuck::cast_slice(&operands).to_vec()),
        Command::Reserve(RESULTS, sizes[1]),
        Command::Reserve(HALVES, sizes[2]),
        Command::Dispatch {
            stage: stage::<R>(),
            bindings: vec![
                Binding::whole(super::PARAMETERS, size_of::<Parameters>() as u64),
                Binding::whole(OPERANDS, sizes[0]),
                Binding::whole(RESULTS, sizes[1]),
                Binding::whole(HALVES, sizes[2]),
            ],
            groups: n.div_ceil(64) as u32,
        },
        Command::Download(RESULTS, sizes[1]),
        Command::Download(HALVES, sizes[2]),
    ];
    let found = state.adapter.run(&commands)?;
    let results: &[[R; 8]] = bytemuck::cast_slice(&found[0]);
    let halves: &[[[u32; 2]; 2]] = bytemuck::cast_slice(&found[1]);
    for ((&[x, y], got), sums) in operands.iter().zip(results).zip(halves) {
        compare(x, y, got, sums).map_err(Error::Arithmetic)?;
    }
    Ok(())
}

/// Compares the results for one pair of operands. On `Err`, a description of the first wrong one.
fn compare<R: Real>(x: R, y: R, got: &[R; 8], sums: &[[u32; 2]; 2]) -> Result<(), String> {
    let (x, y): (f64, f64) = (x.into(), y.into());
    let difference: f64 = got[1].into();
    let unit = R::UNIT_ERROR;
    // The expected results and their maximum relative errors.
    let expected = [
        ("+", x + y, unit),
        ("-", x - y, unit),
        ("*", x * y, unit),
        ("/", x / y, 4.0 * unit),
        ("inverse square root", 1.0 / x.abs().sqrt(), 4.0 * unit),
        (
            "approximate square root",
            x.abs().sqrt(),
            8.0 * f32::UNIT_ERROR,
        ),
        ("x - (x - y)", x - difference, unit),
        ("(x - y) * (x + y)", difference * (x + y), 3.0 * unit),
    ];
    for ((what, want, error), &got) in expected.into_iter().zip(got) {
        let got: f64 = got.into();
        let off = (got - want).abs();
        // The relative error of the expected value is less than this. So sums and products of
        // doubles must be equal.
        let ours = f64::EPSILON;
        let allowed = (error - ours) * want.abs() + R::SMALLEST;
        if off.is_nan() || off > allowed {
            return Err(format!(
                "{what} of {x:e} and {y:e}: expected {want:e}, got {got:e}"
            ));
        }
    }
    let unit = |x: f64| (x / fixed::UNIT).trunc() as i64;
    let wanted = [unit(x), unit(x) + unit(y)];
    for (&got, want) in sums.iter().zip(wanted) {
        if (fixed::whole(got) - want).abs() > 1 {
            return Err(format!(
                "fixed-point sum of {x:e} and {y:e}: expected {want}, got {}",
                fixed::whole(got)
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the results of an adapter without faults.
    fn faultless<R: Real>(x: R, y: R) -> ([R; 8], [[u32; 2]; 2]) {
        let (x, y): (f64, f64) = (x.into(), y.into());
        let rounded = |x: f64| -> f64 { R::nearest(x).into() };
        let (d, s) = (rounded(x - y), x.abs());
        let halves = |v: i64| [v as u32, (v >> 32) as u32];
        let unit = |x: f64| (x / fixed::UNIT).trunc() as i64;
        let results = [
            x + y,
            d,
            x * y,
            x / y,
            1.0 / s.sqrt(),
            s.sqrt(),
            x - d,
            d * rounded(x + y),
        ];
        (
            results.map(R::nearest),
            [halves(unit(x)), halves(unit(x) + unit(y))],
        )
    }

    fn finds_faults_and_no_others<R: Real>() {
        for [x, y] in operands::<R>() {
            let (got, sums) = faultless(x, y);
            assert_eq!(compare(x, y, &got, &sums), Ok(()));
        }
        let (x, y) = (R::nearest(1.0 / 3.0), R::nearest(1e-3));
        let (got, sums) = faultless(x, y);
        for k in 0..8 {
            let mut wrong = got;
            let error = if k == 5 { 1e-5 } else { 64.0 * R::UNIT_ERROR };
            wrong[k] = R::nearest(wrong[k].into() * (1.0 + error));
            assert!(compare(x, y, &wrong, &sums).is_err(), "{k}");
        }
        // A compiler that simplifies x - (x - y) to y.
        let mut simplified = got;
        simplified[6] = y;
        assert!(x.into() - got[1].into() != y.into());
        assert!(compare(x, y, &simplified, &sums).is_err());
        let mut carried = sums;
        carried[1][1] += 1;
        assert!(compare(x, y, &got, &carried).is_err());
    }

    #[test]
    fn finds_faults_of_single_precision() {
        finds_faults_and_no_others::<f32>();
    }

    #[test]
    fn finds_faults_of_double_precision() {
        finds_faults_and_no_others::<f64>();
    }
}
