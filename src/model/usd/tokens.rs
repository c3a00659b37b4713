//! Words of a binary USD file.

use super::layer::WORD_BYTES;
use super::packed::{block, decompress, take};

/// Maximum number of bytes of all words per byte of the file.
const TEXT: u64 = 16;

/// Words of a file.
#[derive(Debug, Default)]
pub(super) struct Tokens {
    text: Vec<u8>,
    /// End of each word, which is the place of its 0.
    ends: Vec<u32>,
    /// Word of each string.
    pub strings: Vec<u32>,
}

impl Tokens {
    /// Reads the section of a file of `bytes` bytes: the number of words, their size, and the
    /// compressed block.
    pub fn read(mut section: &[u8], bytes: u64) -> Result<Tokens, String> {
        let mut number = || take(&mut section).map(u64::from_le_bytes);
        let (Some(count), Some(len)) = (number(), number()) else {
            return Err("the section ends early".into());
        };
        let limit = TEXT * bytes;
        if len > limit {
            return Err(format!(
                "{len} bytes promised, a file of this size has at most {limit}"
            ));
        }
        Tokens::new(decompress(block(&mut section)?, len, true)?, count)
    }

    fn new(text: Vec<u8>, count: u64) -> Result<Tokens, String> {
        let ends = text.iter().zip(0_u32..).filter(|(b, _)| **b == 0);
        let ends: Vec<u32> = ends.map(|(_, k)| k).collect();
        if ends.len() as u64 != count || ends.last().map_or(0, |&e| e as usize + 1) != text.len() {
            return Err(format!("{count} words promised, {} found", ends.len()));
        }
        Ok(Tokens {
            text,
            ends,
            strings: Vec::new(),
        })
    }

    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Returns a word of at most [`WORD_BYTES`].
    pub fn word(&self, token: u32) -> Result<&str, String> {
        let end = self.ends.get(token as usize);
        let end = *end.ok_or_else(|| format!("word {token} of {}", self.len()))? as usize;
        let start = match token {
            0 => 0,
            _ => self.ends[token as usize - 1] as usize + 1,
        };
        if end - start > WORD_BYTES {
            let bytes = end - start;
            return Err(format!(
                "a word of {bytes} bytes; at most {WORD_BYTES} are read"
            ));
        }
        std::str::from_utf8(&self.text[start..end]).map_err(|_| "a word is not UTF-8".into())
    }
}
