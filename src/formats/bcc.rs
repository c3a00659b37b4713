//! Binary Curve Collection (BCC), the format of C. Yuksel's yarn-level models, little-endian:
//!
//! | bytes | content |
//! |---|---|
//! | 0 | `BCC` |
//! | 3 | 0x44: integers of 4 bytes, floats of 4 bytes |
//! | 4 | curve type: `PL`, `C0` (uniform Catmull-Rom), `BS` (cubic B-spline), `BZ` (cubic Bezier) |
//! | 6 | dimensions: 3 |
//! | 7 | up axis, which changes nothing here |
//! | 8 | u64: number of curves |
//! | 16 | u64: control points of all curves |
//! | 24 | 40 bytes of text; some writers leave them undefined |
//! | 64 | for each curve: i32 number of control points, negative if closed; f32 `x y z` of each |

use super::write::create;
use super::{little_endian, quote, with_positions};
use crate::curve::{Basis, CurveSet, Precision};
use crate::error::{Error, Result};
use std::io::{ErrorKind, Read, Write};
use std::path::Path;

const FORMAT: &str = "BCC";
const HEADER_BYTES: usize = 64;
const COUNT_BYTES: u64 = 4;
const POINT_BYTES: usize = 12;
/// Number of control points read at once.
const CHUNK: usize = 4096;

fn code(basis: Basis) -> &'static [u8; 2] {
    match basis {
        Basis::Polyline => b"PL",
        Basis::CatmullRom => b"C0",
        Basis::BSpline => b"BS",
        Basis::Bezier => b"BZ",
    }
}

/// Parses the header. Returns the basis and the numbers of curves and points, which are consistent
/// with the length of the file.
fn header(bytes: &[u8; HEADER_BYTES], len: u64) -> Result<(Basis, u64, u64)> {
    let unsupported = |what: String| Err(Error::unsupported(FORMAT, what));
    let [b'B', b'C', b'C', sizes, t0, t1, dimensions, ..] = *bytes else {
        let what = format!("{}, expected 'BCC'", quote(&bytes[..3]));
        return Err(Error::format(FORMAT, "byte 0", what));
    };
    if sizes != 0x44 {
        return unsupported(format!(
            "number sizes 0x{sizes:02x}; supported is 0x44, integers and floats of 4 bytes"
        ));
    }
    let kind = [t0, t1];
    let Some(basis) = Basis::ALL.into_iter().find(|&b| *code(b) == kind) else {
        let found = quote(&kind);
        return unsupported(format!(
            "curve type {found}; supported are PL, C0, BS and BZ"
        ));
    };
    if dimensions != 3 {
        return unsupported(format!(
            "curves in {dimensions} dimensions; supported are 3"
        ));
    }
    let [curves, points] = [8, 16].map(|at| little_endian(&bytes[at..at + 8]));
    let promised = HEADER_BYTES as u128
        + u128::from(COUNT_BYTES) * u128::from(curves)
        + POINT_BYTES as u128 * u128::from(points);
    if promised != u128::from(len) {
        let what = format!(
            "{curves} curves with {points} points take {promised} bytes, the file has {len}"
        );
        return Err(Error::format(FORMAT, "header", what));
    }
    if points > u64::from(u32::MAX) {
        return Err(Error::count("points of all curves", points, u32::MAX));
    }
    Ok((basis, curves, points))
}

/// Reads a file of `len` bytes.
pub(super) fn read(mut input: impl Read, len: u64) -> Result<CurveSet> {
    let mut bytes = [0; HEADER_BYTES];
    if len < HEADER_BYTES as u64 {
        let what = format!("{len} bytes, the header has {HEADER_BYTES}");
        return Err(Error::format(FORMAT, "header", what));
    }
    fill(&mut input, &mut bytes, || "header".into())?;
    let (basis, curves, points) = header(&bytes, len)?;
    let mut builder = CurveSet::builder(basis, Precision::F32, points as usize);
    let mut at = HEADER_BYTES as u64;
    let mut points_left = points;
    let mut bytes = vec![0; CHUNK.min(points as usize) * POINT_BYTES];
    for curve in 0..curves {
        let place = |at: u64| format!("byte {at}, curve {curve}");
        let mut count = [0; COUNT_BYTES as usize];
        fill(&mut input, &mut count, || place(at))?;
        let count = i32::from_le_bytes(count);
        let n = count.unsigned_abs();
        // The layout on the bus cannot represent the negative of the smallest integer.
        if count == i32::MIN || u64::from(n) > points_left {
            let what = format!("{n} points promised, {points_left} of the file are left");
            return Err(Error::format(FORMAT, place(at), what));
        }
        builder.start_curve(n as usize, count < 0)?;
        at += COUNT_BYTES;
        points_left -= u64::from(n);
        let mut left = n as usize;
        while left > 0 {
            let bytes = &mut bytes[..left.min(CHUNK) * POINT_BYTES];
            fill(&mut input, bytes, || place(at))?;
            with_positions(Precision::F32, bytes, |positions| builder.push(positions))?;
            at += bytes.len() as u64;
            left -= bytes.len() / POINT_BYTES;
        }
    }
    if points_left > 0 {
        let found = points - points_left;
        let what = format!("{points} points promised, the curves have {found}");
        return Err(Error::format(FORMAT, "byte 16", what));
    }
    builder.finish()
}

/// Fills `bytes`. The length of the file was checked, so an early end means that the file shrank
/// meanwhile.
fn fill(input: &mut impl Read, bytes: &mut [u8], place: impl FnOnce() -> String) -> Result<()> {
    input.read_exact(bytes).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => Error::format(FORMAT, place(), "the file ends here"),
        _ => Error::Io(e),
    })
}

/// Writes a BCC file.
///
/// The format has single precision. A set in double precision is rejected, before the file is
/// created, unless single precision represents each of its coordinates exactly.
///
/// # Errors
///
/// [`Error::Unsupported`] for coordinates that single precision does not hold; [`Error::File`].
pub fn write_bcc(path: &Path, set: &CurveSet) -> Result<()> {
    check_precision(FORMAT, set).map_err(|e| e.in_file(path))?;
    create(path, |out| write(out, set))
}

/// Fails if single precision would round a coordinate.
pub(super) fn check_precision(format: &'static str, set: &CurveSet) -> Result<()> {
    if set.precision() == Precision::F32 {
        return Ok(());
    }
    for i in 0..set.len() {
        for (k, p) in set.points_in(i).enumerate() {
            if let Some(x) = p.iter().position(|&x| f64::from(x as f32) != x) {
                let (axis, value) = (['x', 'y', 'z'][x], p[x]);
                let what = format!(
                    "curve {i}, point {k}: coordinate {axis} is {value}, which the format's single \
                     precision would round"
                );
                return Err(Error::unsupported(format, what));
            }
        }
    }
    Ok(())
}

fn write(out: &mut dyn Write, set: &CurveSet) -> std::io::Result<()> {
    out.write_all(b"BCC\x44")?;
    out.write_all(code(set.basis()))?;
    // Three dimensions, with y up as in the published models.
    out.write_all(&[3, 1])?;
    out.write_all(&(set.len() as u64).to_le_bytes())?;
    out.write_all(&(set.points() as u64).to_le_bytes())?;
    write!(out, "{:\0<40}", "linkwatch")?;
    for (i, count) in set.counts().enumerate() {
        out.write_all(&count.to_le_bytes())?;
        for x in set.points_in(i).flatten() {
            out.write_all(&(x as f32).to_le_bytes())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Positions;
    use crate::formats::tests::{assert_error_contains, curves};
    use proptest::prelude::*;

    fn bytes_of(set: &CurveSet) -> Vec<u8> {
        let mut out = Vec::new();
        write(&mut out, set).unwrap();
        out
    }

    fn parse(bytes: &[u8]) -> Result<CurveSet> {
        read(bytes, bytes.len() as u64)
    }

    /// Two closed curves and an open one, with sizes that fit every basis.
    fn sample(basis: Basis) -> CurveSet {
        let (closed, open) = (12, 13);
        let xyz: Vec<f32> = (0..3 * (2 * closed + open))
            .map(|k| (k as f32 * 0.7).sin())
            .collect();
        CurveSet::from_counts(basis, &[-closed, open, -closed], Positions::F32(&xyz)).unwrap()
    }

    #[test]
    fn every_basis_round_trips() {
        for basis in Basis::ALL {
            let set = sample(basis);
            let back = parse(&bytes_of(&set)).unwrap();
            assert_eq!(back.basis(), basis);
            assert_eq!(back.precision(), Precision::F32);
            assert_eq!(curves(&back), curves(&set));
        }
    }

    #[test]
    fn reads_long_curves_in_small_chunks() {
        struct Watched<'a>(&'a [u8], usize);
        impl Read for Watched<'_> {
            fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
                self.1 = self.1.max(to.len());
                // A short read, as pipes and signals cause them.
                let n = to.len().min(1000);
                self.0.read(&mut to[..n])
            }
        }
        let n = 3 * CHUNK + 5;
        let xyz: Vec<f32> = (0..3 * n).map(|k| k as f32).collect();
        let counts = [-(n as i32)];
        let set = CurveSet::from_counts(Basis::BSpline, &counts, Positions::F32(&xyz)).unwrap();
        let bytes = bytes_of(&set);
        let mut input = Watched(&bytes, 0);
        let back = read(&mut input, bytes.len() as u64).unwrap();
        assert_eq!(curves(&back), curves(&set));
        assert!(input.1 <= CHUNK * POINT_BYTES);
    }

    #[test]
    fn writes_double_precision_only_if_no_coordinate_is_rounded() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bcc");
        let mut xyz = [0.5, -0.25, 1e10, 3.0, 4.0, -0.0];
        let set = |xyz: &[f64]| {
            CurveSet::from_counts(Basis::Polyline, &[2], Positions::F64(xyz)).unwrap()
        };
        write_bcc(&path, &set(&xyz)).unwrap();
        assert_eq!(
            curves(&super::super::read(&path).unwrap()),
            curves(&set(&xyz))
        );
        std::fs::remove_file(&path).unwrap();
        for lost in [0.1, 1e300, 1e-300] {
            xyz[4] = lost;
            let e = write_bcc(&path, &set(&xyz)).unwrap_err().to_string();
            assert!(
                e.contains("a.bcc: unsupported BCC: curve 0, point 1"),
                "{e}"
            );
            assert!(e.contains("coordinate y"), "{e}");
            assert!(!path.exists());
        }
    }

    #[test]
    fn rejects_wrong_headers() {
        let good = bytes_of(&sample(Basis::Polyline));
        let with = |at: usize, new: &[u8]| {
            let mut b = good.clone();
            b[at..at + new.len()].copy_from_slice(new);
            parse(&b)
        };
        assert_error_contains(with(0, b"PNG"), "byte 0): 'PNG', expected 'BCC'");
        assert_error_contains(with(3, &[0x48]), "unsupported BCC: number sizes 0x48");
        assert_error_contains(with(4, b"C1"), "unsupported BCC: curve type 'C1'");
        assert_error_contains(with(4, b"CH"), "unsupported BCC: curve type 'CH'");
        assert_error_contains(with(6, &[2]), "in 2 dimensions");
        for huge in [1 << 40, u64::MAX, u64::MAX / 12] {
            assert_error_contains(with(8, &u64::to_le_bytes(huge)), "the file has");
            assert_error_contains(with(16, &u64::to_le_bytes(huge)), "the file has");
        }
        // Fewer points and more curves that take the same number of bytes.
        let mut b = good.clone();
        b[8] += 3;
        b[16] -= 1;
        assert!(parse(&b).is_err());
        let mut longer = good.clone();
        longer.push(0);
        assert_error_contains(parse(&longer), "the file has 521");
        assert_error_contains(parse(&good[..63]), "63 bytes, the header has 64");
        assert_error_contains(parse(&[]), "0 bytes");
    }

    #[test]
    fn rejects_wrong_counts() {
        let good = bytes_of(&sample(Basis::Polyline));
        let with = |count: i32| {
            let mut b = good.clone();
            b[64..68].copy_from_slice(&count.to_le_bytes());
            parse(&b)
        };
        assert_error_contains(with(i32::MIN), "byte 64, curve 0): 2147483648 points");
        assert_error_contains(with(i32::MAX), "2147483647 points promised, 37 of the file");
        assert_error_contains(with(38), "38 points promised, 37");
        assert_error_contains(with(0), "curve 0: 0 control points");
        assert_error_contains(with(1), "curve 0: 1 control points");
        assert!(with(-11).is_err());
        // The last curve lacks a point, so its point remains.
        let mut b = good.clone();
        let last = b.len() - 12 * 12 - 4;
        b[last..last + 4].copy_from_slice(&(-11i32).to_le_bytes());
        assert_error_contains(
            parse(&b),
            "byte 16): 37 points promised, the curves have 36",
        );
        // A file that shrank after its length was read.
        let cut = read(&good[..100], good.len() as u64);
        assert_error_contains(cut, "byte 68, curve 0): the file ends here");
    }

    #[test]
    fn errors_name_values_that_are_not_finite() {
        let mut b = bytes_of(&sample(Basis::CatmullRom));
        b[68 + 12 + 4..68 + 12 + 8].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_error_contains(parse(&b), "curve 0, point 1: coordinate y is NaN");
    }

    proptest! {
        #[test]
        fn any_set_round_trips(
            basis in prop::sample::select(&Basis::ALL[..]),
            sizes in prop::collection::vec((1..40usize, any::<bool>()), 0..6),
            bits in prop::collection::vec(any::<u32>(), 1..50),
        ) {
            let counts: Vec<i32> = sizes
                .into_iter()
                .filter(|&(n, closed)| basis.segments(n, closed).is_some())
                .map(|(n, closed)| if closed { -(n as i32) } else { n as i32 })
                .collect();
            let points: u32 = counts.iter().map(|c| c.unsigned_abs()).sum();
            let finite = bits.iter().map(|&b| f32::from_bits(b)).filter(|x| x.is_finite());
            let xyz: Vec<f32> = finite.chain([1.0]).cycle().take(3 * points as usize).collect();
            let set = CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap();
            let back = parse(&bytes_of(&set)).unwrap();
            prop_assert_eq!(curves(&back), curves(&set));
        }
    }
}
