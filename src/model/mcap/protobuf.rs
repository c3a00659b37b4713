//! Fields of protobuf messages. Source: <https://protobuf.dev/programming-guides/encoding/>.
//!
//! Reads in place: a message takes no memory but that of the values that its type keeps.

/// A value of a field.
pub(super) enum Value<'a> {
    Varint(u64),
    Fixed64([u8; 8]),
    Fixed32([u8; 4]),
    Bytes(&'a [u8]),
}

/// A message that takes its fields one by one.
pub(super) trait Message {
    /// Takes a field. The error is in words. Unknown fields are ignored.
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String>;
}

/// Reads the fields of a message.
pub(super) fn merge(message: &mut impl Message, mut bytes: &[u8]) -> Result<(), String> {
    while !bytes.is_empty() {
        let key = varint(&mut bytes)?;
        let value = match key & 7 {
            0 => Value::Varint(varint(&mut bytes)?),
            1 => Value::Fixed64(fixed(&mut bytes)?),
            2 => {
                let length = varint(&mut bytes)?;
                let there = bytes.len();
                let n = usize::try_from(length).ok().filter(|&n| n <= there);
                let (value, rest) = bytes.split_at(n.ok_or_else(|| {
                    format!("a field of {length} bytes, {there} are left in the message")
                })?);
                bytes = rest;
                Value::Bytes(value)
            }
            5 => Value::Fixed32(fixed(&mut bytes)?),
            other => return Err(format!("a field with wire type {other}")),
        };
        message.field(key >> 3, &value)?;
    }
    Ok(())
}

fn varint(bytes: &mut &[u8]) -> Result<u64, String> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first().ok_or("the message ends in a number")?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err("a number of more than ten bytes".into())
}

fn fixed<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], String> {
    let (value, rest) = bytes
        .split_first_chunk()
        .ok_or("the message ends in a number")?;
    *bytes = rest;
    Ok(*value)
}

impl Value<'_> {
    pub fn integer(&self) -> Result<i64, String> {
        match self {
            Value::Varint(value) => Ok(*value as i64),
            _ => Err("a field that is not an integer".into()),
        }
    }

    pub fn double(&self) -> Result<f64, String> {
        match self {
            Value::Fixed64(bytes) => Ok(f64::from_le_bytes(*bytes)),
            _ => Err("a field that is not a double".into()),
        }
    }

    pub fn bytes(&self) -> Result<&[u8], String> {
        match self {
            Value::Bytes(bytes) => Ok(bytes),
            _ => Err("a field that is neither a message nor a string".into()),
        }
    }

    pub fn string(&self) -> Result<String, String> {
        let text = String::from_utf8(self.bytes()?.into());
        text.map_err(|_| "a string that is not UTF-8".into())
    }

    /// Appends `fixed32` numbers, packed or one by one.
    pub fn fixed32(&self, to: &mut Vec<u32>) -> Result<(), String> {
        let numbers: &[[u8; 4]] = match self {
            Value::Fixed32(one) => std::slice::from_ref(one),
            other => match other.bytes()?.as_chunks() {
                (numbers, []) => numbers,
                _ => return Err("packed numbers that end within one".into()),
            },
        };
        to.extend(numbers.iter().map(|b| u32::from_le_bytes(*b)));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Numbers(Vec<(u64, i64)>, Vec<u32>);

    impl Message for Numbers {
        fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
            match number {
                9 => value.fixed32(&mut self.1),
                _ => {
                    self.0.push((number, value.integer()?));
                    Ok(())
                }
            }
        }
    }

    fn read(bytes: &[u8]) -> Result<Numbers, String> {
        let mut numbers = Numbers::default();
        merge(&mut numbers, bytes).map(|()| numbers)
    }

    #[test]
    fn reads_numbers_packed_or_not() {
        let numbers = read(b"\x08\x96\x01\x10\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01").unwrap();
        assert_eq!(numbers.0, [(1, 150), (2, -1)]);
        let bytes = b"\x4a\x08\x01\0\0\0\x02\0\0\0\x4d\x03\0\0\0";
        assert_eq!(read(bytes).unwrap().1, [1, 2, 3]);
    }

    #[test]
    fn rejects_fields_that_end_beyond_the_message() {
        for (bytes, expected) in [
            (&b"\x08"[..], "ends in a number"),
            (b"\x4d\x03\0\0", "ends in a number"),
            (b"\x4a\x08\x01\0", "a field of 8 bytes, 2 are left"),
            (
                b"\x4a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01",
                "0 are left",
            ),
            (b"\x4a\x03\x01\0\0", "end within one"),
            (
                b"\x08\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01",
                "ten bytes",
            ),
            (b"\x0b", "wire type 3"),
            (b"\x0d\0\0\0\0", "not an integer"),
        ] {
            let e = read(bytes).err().unwrap();
            assert!(e.contains(expected), "{e}");
        }
    }
}
