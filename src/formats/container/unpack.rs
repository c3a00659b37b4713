//! Unpacks chunks: LZ4 frames and Zstandard, as other tools write them.

use std::io::Read;

/// Unpacks the records of a chunk, which has `promised` bytes. The error is a text.
///
/// Memory: grows with the bytes that are unpacked, up to the promised number, which must not exceed
/// `limit`.
pub(super) fn unpack(
    compression: &str,
    stored: &[u8],
    promised: u64,
    limit: u64,
) -> Result<Vec<u8>, String> {
    if promised > limit {
        return Err(format!(
            "{promised} bytes of unpacked records promised, at most {limit} are read"
        ));
    }
    match compression {
        "lz4" => read(lz4_flex::frame::FrameDecoder::new(stored), promised),
        "zstd" => {
            let decoder = ruzstd::decoding::StreamingDecoder::new(stored);
            let decoder = decoder.map_err(|e| format!("cannot be unpacked: {e}"))?;
            read(decoder, promised)
        }
        other => Err(format!(
            "compressed with {other:?}; \"lz4\" and \"zstd\" are read"
        )),
    }
}

fn read(unpacked: impl Read, promised: u64) -> Result<Vec<u8>, String> {
    let mut records = Vec::new();
    // One byte more shows that there are too many.
    let limit = promised.saturating_add(1);
    let read = unpacked.take(limit).read_to_end(&mut records);
    read.map_err(|e| format!("cannot be unpacked: {e}"))?;
    match records.len() as u64 {
        n if n == promised => Ok(records),
        n if n < promised => Err(format!("{promised} bytes promised, {n} unpacked")),
        _ => Err(format!("{promised} bytes promised, more unpacked")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Container, Content, Ending, MAGIC, op};
    use super::*;
    use prost::bytes::Bytes;
    use std::io::{Cursor, Write};

    fn lz4(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn zstd(bytes: &[u8]) -> Vec<u8> {
        let level = ruzstd::encoding::CompressionLevel::Fastest;
        ruzstd::encoding::compress_to_vec(bytes, level)
    }

    fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
        let length = (body.len() as u64).to_le_bytes();
        [&[opcode][..], &length, body].concat()
    }

    /// A file with a chunk of messages.
    fn file(messages: usize, compression: &str, pack: fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
        let records: Vec<u8> = (0..messages)
            .flat_map(|k| record(op::MESSAGE, &[k as u8; 40]))
            .collect();
        let packed = pack(&records);
        let chunk = [
            &[0; 16][..],
            &(records.len() as u64).to_le_bytes(),
            &crc32fast::hash(&records).to_le_bytes(),
            &(compression.len() as u32).to_le_bytes(),
            compression.as_bytes(),
            &(packed.len() as u64).to_le_bytes(),
            &packed,
        ];
        let end = [&record(op::DATA_END, &[0; 4])[..], MAGIC].concat();
        [MAGIC, &record(op::CHUNK, &chunk.concat()), &end].concat()
    }

    /// Reads to the end or the first error.
    fn messages(bytes: &[u8]) -> Result<usize, String> {
        let mut container = Container::new(Cursor::new(bytes)).map_err(|e| e.to_string())?;
        let mut found = 0;
        while let Some((_, content)) = container.next().map_err(|e| e.to_string())? {
            // Without its header of 22 bytes.
            let is_whole = |body: &Bytes| body.len() == 18;
            found +=
                usize::from(matches!(content, Content::Message(_, _, body) if is_whole(&body)));
        }
        match container.ending() {
            Some(Ending::Finished) => Ok(found),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn reads_compressed_chunks_and_survives_their_damage() {
        for (compression, pack) in [("lz4", lz4 as fn(&[u8]) -> Vec<u8>), ("zstd", zstd)] {
            let whole = file(30, compression, pack);
            assert!(whole.len() < 1000, "compressed");
            assert_eq!(messages(&whole), Ok(30));
            for at in 0..whole.len() {
                // Only the end may be missing.
                let cut = messages(&whole[..at]);
                assert!(cut.is_err() || cut == Ok(30), "{compression}, cut at {at}");
                for flip in [0x01, 0xff] {
                    let mut bytes = whole.clone();
                    bytes[at] ^= flip;
                    // Changes of some bytes have no effect: times, checksums of the compressor.
                    if let Ok(n) = messages(&bytes) {
                        assert!(n == 30 || n == 0, "{compression}, byte {at}: {n}");
                    }
                }
                if at + 8 <= whole.len() {
                    let mut bytes = whole.clone();
                    bytes[at..at + 8].copy_from_slice(&(u64::MAX - 8).to_le_bytes());
                    messages(&bytes).ok();
                }
            }
        }
    }

    #[test]
    fn names_an_unknown_compression() {
        let e = messages(&file(3, "brotli", <[u8]>::to_vec)).unwrap_err();
        assert!(e.contains("compressed with \"brotli\""), "{e}");
    }

    #[test]
    fn unpacks_no_more_than_promised() {
        let zeros = vec![0; 1 << 20];
        for (compression, packed) in [("lz4", lz4(&zeros)), ("zstd", zstd(&zeros))] {
            let whole = unpack(compression, &packed, 1 << 20, 1 << 20).unwrap();
            assert!(whole == zeros);
            let e = unpack(compression, &packed, 1000, 1 << 20).unwrap_err();
            assert_eq!(e, "1000 bytes promised, more unpacked");
            let e = unpack(compression, &packed, 1 << 21, 1 << 20).unwrap_err();
            assert!(e.contains("at most 1048576 are read"), "{e}");
            let e = unpack(compression, &packed, 1 << 21, 1 << 22).unwrap_err();
            assert_eq!(e, "2097152 bytes promised, 1048576 unpacked");
        }
    }
}
