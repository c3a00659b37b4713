//! Random changes of the bytes of a file.

use super::support::random::Random;

/// Numbers that overflow if a reader computes with them unchecked.
const HUGE: [u64; 6] = [
    u64::MAX,
    1 << 63,
    1 << 40,
    1 << 32,
    1 << 31,
    u32::MAX as u64,
];

/// Returns a changed copy: bytes flipped, cut off, removed, repeated or replaced by huge numbers.
pub fn changed(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(3) {
        if bytes.len() < 16 {
            break;
        }
        let at = random.below(bytes.len() - 8);
        let length = random.below((bytes.len() - at).min(200));
        match random.below(6) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes.truncate(at),
            2 => drop(bytes.drain(at..at + length)),
            3 => {
                let part = bytes[at..at + length].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, part);
            }
            4 => bytes[at..at + 8].copy_from_slice(&random.pick(&HUGE).to_le_bytes()),
            _ => bytes[at..at + 4].copy_from_slice(&(random.next() as u32).to_le_bytes()),
        }
    }
    bytes
}
