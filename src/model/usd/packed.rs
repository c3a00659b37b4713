//! Compressed blocks of binary USD files: LZ4, and integers as differences.
//!
//! A promised size is compared with the largest that its compressed bytes can have, before anything
//! is allocated: one byte of LZ4 makes at most 255. As integers take two bits or more, that would
//! still be a thousand integers per byte; so a limit, which follows from the size of the file, is
//! checked as well.
//!
//! The differences are stored in a block as one frequent difference, two bits for each integer, and
//! the other differences in one, two or four bytes. Source: `pxr/usd/sdf/integerCoding.cpp` and
//! `pxr/base/tf/fastCompression.cpp` of OpenUSD.

/// Largest number of bytes that one byte of LZ4 makes.
const RATIO: u64 = 255;

/// Returns the `len` bytes of a compressed block. It may decompress to fewer bytes if `exact` is
/// false.
pub(super) fn decompress(block: &[u8], len: u64, exact: bool) -> Result<Vec<u8>, String> {
    let Some((&parts, mut rest)) = block.split_first() else {
        return Err("an empty compressed block".into());
    };
    let most = RATIO * rest.len() as u64;
    // An upper bound of the length may be larger.
    if exact && len > most {
        let packed = rest.len();
        return Err(format!("{len} bytes promised by {packed} compressed bytes"));
    }
    let mut out = vec![0; len.min(most) as usize];
    let mut filled = 0;
    if parts == 0 {
        filled = part(rest, &mut out)?;
    } else {
        for _ in 0..parts {
            let (size, next) = rest
                .split_first_chunk()
                .ok_or("a compressed block ends early")?;
            let size = u32::from_le_bytes(*size) as usize;
            if size > next.len() {
                return Err(format!(
                    "{size} compressed bytes promised, {} left",
                    next.len()
                ));
            }
            filled += part(&next[..size], &mut out[filled..])?;
            rest = &next[size..];
        }
    }
    if exact && filled as u64 != len {
        return Err(format!("{len} bytes promised, {filled} decompressed"));
    }
    out.truncate(filled);
    Ok(out)
}

fn part(block: &[u8], out: &mut [u8]) -> Result<usize, String> {
    lz4_flex::block::decompress_into(block, out).map_err(|e| format!("compressed bytes: {e}"))
}

/// Returns the `count` integers of a compressed block, which are at most `limit`.
pub(super) fn integers(block: &[u8], count: u64, limit: u64) -> Result<Vec<i32>, String> {
    if count == 0 {
        return Ok(Vec::new());
    }
    if count > limit {
        return Err(format!(
            "{count} integers promised, a file of this size has at most {limit}"
        ));
    }
    let codes = count.div_ceil(4);
    let least = 4 + codes;
    if least > RATIO * block.len() as u64 {
        let packed = block.len();
        return Err(format!(
            "{count} integers promised by {packed} compressed bytes"
        ));
    }
    let most = least + 4 * count;
    let bytes = decompress(block, most, false)?;
    let ends = || format!("{count} integers promised, the block ends early");
    let (common, rest) = bytes.split_first_chunk().ok_or_else(ends)?;
    let common = i32::from_le_bytes(*common);
    let (codes, mut rest) = rest.split_at_checked(codes as usize).ok_or_else(ends)?;
    let mut values = Vec::with_capacity(count as usize);
    let mut value = 0_i32;
    for k in 0..count as usize {
        let difference = match codes[k / 4] >> (2 * (k % 4)) & 3 {
            0 => common,
            1 => i8::from_le_bytes(take(&mut rest).ok_or_else(ends)?).into(),
            2 => i16::from_le_bytes(take(&mut rest).ok_or_else(ends)?).into(),
            _ => i32::from_le_bytes(take(&mut rest).ok_or_else(ends)?),
        };
        value = value.wrapping_add(difference);
        values.push(value);
    }
    Ok(values)
}

/// Takes a block from the front of a section: its number of bytes, and these.
pub(super) fn block<'a>(section: &mut &'a [u8]) -> Result<&'a [u8], String> {
    let size = take(section).map(u64::from_le_bytes);
    let size = size.ok_or("the section ends early")?;
    let found = section.len();
    let split = usize::try_from(size)
        .ok()
        .and_then(|n| section.split_at_checked(n));
    let (block, rest) = split.ok_or(format!("{size} bytes promised, {found} are left"))?;
    *section = rest;
    Ok(block)
}

/// Takes bytes from the front.
pub(super) fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}

/// Returns a number in half precision.
pub(super) fn half(bytes: [u8; 2]) -> f32 {
    let bits = u16::from_le_bytes(bytes);
    let exponent = i32::from(bits >> 10 & 31);
    let fraction = f32::from(bits & 1023);
    let magnitude = match exponent {
        0 => fraction * 2_f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1024.0 + fraction) * 2_f32.powi(exponent - 25),
    };
    if bits >> 15 == 1 {
        -magnitude
    } else {
        magnitude
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_have_their_values() {
        for (bits, value) in [
            (0x3c00_u16, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333_251_95),
            (0x0001, 5.960_464_5e-8),
            (0x7bff, 65504.0),
            (0x7c00, f32::INFINITY),
        ] {
            assert_eq!(half(bits.to_le_bytes()), value);
        }
        assert!(half(0x7e00_u16.to_le_bytes()).is_nan());
    }

    #[test]
    fn a_small_block_cannot_promise_much() {
        for count in [1 << 20, 1 << 40, u64::MAX / 8] {
            assert!(integers(&[0, 0x10, 7], count, u64::MAX).is_err());
            assert!(decompress(&[0, 0x10, 7], count, true).is_err());
            assert!(
                integers(&[0; 9000], count, 9000)
                    .unwrap_err()
                    .contains("at most 9000")
            );
        }
        assert!(decompress(&[], 1, true).is_err());
        assert!(decompress(&[2, 9, 0, 0, 0, 1], 10, true).is_err());
    }
}
