//! Whether the arithmetic of an adapter is what the bounds rest on: asked once, when it is opened.
//!
//! No sample proves it. What it finds is what drivers get wrong as a whole: operations that are approximated, terms that
//! are regrouped in spite of the pins, conversions and carries.

use super::Engine;
use super::commands::{Binding, Buffer, Command, Stage};
use super::direct::UNIT_ERROR;
use super::error::Trouble;
use super::fixed;
use super::layout::Parameters;

/// The program.
pub(super) const STAGE: Stage = Stage {
    name: "self test",
    source: || super::program(&[], &[], &[include_str!("self_test.wgsl")]),
};

const OPERANDS: Buffer = Buffer("operands", "self test");
const RESULTS: Buffer = Buffer("results", "self test");
const HALVES: Buffer = Buffer("halves", "self test");

/// Numbers to try: all kinds of mantissas, within the range of what kernels meet.
fn operands() -> Vec<[f32; 2]> {
    let mut state = 0x2545_f491_4f6c_dd1du64;
    let mut next = |spread: i32| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let mantissa = 1.0 + (state >> 41) as f32 * f32::EPSILON;
        let exponent = (state >> 8 & 0xff) as i32 % spread;
        let sign = if state & 1 == 0 { 1.0 } else { -1.0 };
        sign * mantissa * 2f32.powi(-exponent)
    };
    let mut out: Vec<[f32; 2]> = (0..4096).map(|k| [next(20), next(1 + k % 40)]).collect();
    // Neighbours: their differences are exact on every machine, or it is none to be used.
    let x = 1.0f32 / 3.0;
    for k in 0..64 {
        out.push([x, f32::from_bits(x.to_bits() + k)]);
    }
    out
}

/// Runs the program and compares.
pub(super) fn run(engine: &mut Engine) -> Result<(), Trouble> {
    let operands = operands();
    let n = operands.len() as u64;
    let parameters = Parameters {
        radius: 0.0,
        zero: 0,
        first: 0,
        items: n as u32,
    };
    let binding = |buffer, size| Binding {
        buffer,
        offset: 0,
        size,
    };
    let sizes = [8 * n, 32 * n, 16 * n];
    let commands = [
        Command::Upload(super::PARAMETERS, bytemuck::bytes_of(&parameters).to_vec()),
        Command::Upload(OPERANDS, bytemuck::cast_slice(&operands).to_vec()),
        Command::Reserve(RESULTS, sizes[1]),
        Command::Reserve(HALVES, sizes[2]),
        Command::Dispatch {
            stage: STAGE,
            bindings: vec![
                binding(super::PARAMETERS, size_of::<Parameters>() as u64),
                binding(OPERANDS, sizes[0]),
                binding(RESULTS, sizes[1]),
                binding(HALVES, sizes[2]),
            ],
            groups: n.div_ceil(64) as u32,
        },
        Command::Download(RESULTS, sizes[1]),
        Command::Download(HALVES, sizes[2]),
    ];
    let found = engine.device.run(&commands)?;
    let results: &[[f32; 8]] = bytemuck::cast_slice(&found[0]);
    let halves: &[[[u32; 2]; 2]] = bytemuck::cast_slice(&found[1]);
    for ((&[x, y], got), sums) in operands.iter().zip(results).zip(halves) {
        compare(x, y, got, sums).map_err(Trouble::Arithmetic)?;
    }
    Ok(())
}

/// What is wrong with the results for one pair of operands, in words.
fn compare(x: f32, y: f32, got: &[f32; 8], sums: &[[u32; 2]; 2]) -> Result<(), String> {
    let (p, q) = (f64::from(x), f64::from(y));
    let difference = f64::from(got[1]);
    // The true result, and how far off it may be in units of the bounds.
    let expected = [
        ("+", p + q, 1.0),
        ("-", p - q, 1.0),
        ("*", p * q, 1.0),
        ("/", p / q, 4.0),
        ("inverseSqrt", 1.0 / p.abs().sqrt(), 4.0),
        ("sqrt", p.abs().sqrt(), 8.0),
        ("x - (x - y)", p - difference, 1.0),
        ("(x - y) * (x + y)", difference * (p + q), 3.0),
    ];
    for ((what, want, units), &got) in expected.into_iter().zip(got) {
        let off = (f64::from(got) - want).abs();
        let allowed = units * UNIT_ERROR * want.abs() + f64::from(f32::MIN_POSITIVE);
        if off.is_nan() || off > allowed {
            return Err(format!(
                "{what} of {x:e} and {y:e} is {want:e}, not {got:e}"
            ));
        }
    }
    let unit = |x: f64| (x / fixed::UNIT).trunc() as i64;
    let wanted = [unit(p), unit(p) + unit(q)];
    for (&got, want) in sums.iter().zip(wanted) {
        if (fixed::whole(got) - want).abs() > 1 {
            return Err(format!(
                "{x:e} and {y:e} in fixed point: {}, not {want}",
                fixed::whole(got)
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What an adapter without faults answers.
    fn faultless(x: f32, y: f32) -> ([f32; 8], [[u32; 2]; 2]) {
        let d = x - y;
        let s = x.abs();
        let halves = |v: i64| [v as u32, (v >> 32) as u32];
        let unit = |x: f32| (f64::from(x) / fixed::UNIT).trunc() as i64;
        (
            [
                x + y,
                d,
                x * y,
                x / y,
                1.0 / s.sqrt(),
                s.sqrt(),
                x - d,
                d * (x + y),
            ],
            [halves(unit(x)), halves(unit(x) + unit(y))],
        )
    }

    #[test]
    fn faults_are_found_and_only_those() {
        for [x, y] in operands() {
            let (got, sums) = faultless(x, y);
            assert_eq!(compare(x, y, &got, &sums), Ok(()));
        }
        let (x, y) = (1.0f32 / 3.0, 1e-3f32);
        let (got, sums) = faultless(x, y);
        for k in 0..8 {
            let mut wrong = got;
            wrong[k] *= 1.000_01;
            assert!(compare(x, y, &wrong, &sums).is_err(), "{k}");
        }
        // A compiler that simplifies x - (x - y) to y.
        let mut simplified = got;
        simplified[6] = y;
        assert!(f64::from(x) - f64::from(got[1]) != f64::from(y));
        assert!(compare(x, y, &simplified, &sums).is_err());
        let mut carried = sums;
        carried[1][1] += 1;
        assert!(compare(x, y, &got, &carried).is_err());
    }
}
