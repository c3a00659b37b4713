//! Values of ROS 2 messages: CDR, little-endian (XCDR version 1). Source: OMG *DDS-XTypes* 1.3,
//! section 7.4.

/// Bytes of a message after its header. Values are aligned to their size from here on.
pub(super) struct Cdr<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cdr<'a> {
    /// Reads the header.
    pub fn new(message: &'a [u8]) -> Result<Cdr<'a>, String> {
        match message {
            [0, 1, _, _, bytes @ ..] => Ok(Cdr { bytes, at: 0 }),
            [0, 0, ..] => Err("big-endian CDR; only little-endian is read".into()),
            [a, b, ..] => Err(format!(
                "CDR of the kind {a:02x} {b:02x}; only 00 01 (plain, little-endian) is read"
            )),
            _ => Err("a message without the header of CDR".into()),
        }
    }

    /// Returns the number of bytes that are left.
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take<const N: usize>(&mut self, align: usize) -> Result<[u8; N], String> {
        self.at = self.at.next_multiple_of(align).min(self.bytes.len());
        let value = self.bytes[self.at..].first_chunk();
        let value = value.ok_or("the message ends in a number")?;
        self.at += N;
        Ok(*value)
    }

    pub fn u8(&mut self) -> Result<u8, String> {
        self.take(1).map(|[byte]| byte)
    }

    pub fn i32(&mut self) -> Result<i32, String> {
        self.take(4).map(i32::from_le_bytes)
    }

    pub fn u32(&mut self) -> Result<u32, String> {
        self.take(4).map(u32::from_le_bytes)
    }

    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.take(8).map(f64::from_le_bytes)?;
        }
        Ok(values)
    }

    /// Reads the number of elements of a sequence, which have at least `bytes` bytes each.
    pub fn count(&mut self, bytes: usize) -> Result<usize, String> {
        let count = self.u32()? as usize;
        let left = self.left();
        match count.checked_mul(bytes).filter(|&n| n <= left) {
            Some(_) => Ok(count),
            None => Err(format!(
                "{count} elements of {bytes} bytes promised, {left} bytes are left"
            )),
        }
    }

    /// Skips a sequence of elements of `bytes` bytes without padding between them.
    pub fn skip(&mut self, bytes: usize) -> Result<(), String> {
        let count = self.count(bytes)?;
        self.at += count * bytes;
        Ok(())
    }

    pub fn string(&mut self) -> Result<String, String> {
        let count = self.count(1)?;
        let text = &self.bytes[self.at..self.at + count];
        self.at += count;
        // The length includes the zero at the end.
        let text = text.strip_suffix(&[0]).unwrap_or(text);
        String::from_utf8(text.into()).map_err(|_| "a string that is not UTF-8".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_to_their_size() {
        let mut message = vec![0, 1, 0, 0, 7, 0, 0, 0, 9, 0, 0, 0];
        message.extend(1.5f64.to_le_bytes());
        message.extend([3, 0, 0, 0, b'a', b'b', 0, 1]);
        let mut cdr = Cdr::new(&message).unwrap();
        assert_eq!((cdr.u8(), cdr.u32()), (Ok(7), Ok(9)));
        assert_eq!(cdr.f64s(), Ok([1.5]));
        assert_eq!(cdr.string(), Ok("ab".into()));
        assert_eq!((cdr.u8(), cdr.left()), (Ok(1), 0));
        assert!(cdr.u8().is_err() && cdr.i32().is_err() && cdr.f64s::<1>().is_err());
    }

    #[test]
    fn counts_are_compared_with_the_bytes_that_are_left() {
        let message = [0, 1, 0, 0, 255, 255, 255, 255, 1, 2];
        for bytes in [1, 24, usize::MAX] {
            let e = Cdr::new(&message).unwrap().count(bytes).unwrap_err();
            assert!(e.contains("2 bytes are left"), "{e}");
        }
        assert!(Cdr::new(&message).unwrap().string().is_err());
        assert!(Cdr::new(&message).unwrap().skip(8).is_err());
    }

    #[test]
    fn names_other_kinds_of_cdr() {
        let fails = |message: &[u8]| Cdr::new(message).err().unwrap();
        assert!(fails(&[0, 0, 0, 0, 1]).contains("big-endian"));
        assert!(fails(&[0, 9, 0, 0, 1]).contains("00 09"));
        assert!(fails(&[0, 1]).contains("without the header") || fails(&[0, 1]).contains("00 01"));
        assert!(fails(&[]).contains("without the header"));
    }
}
