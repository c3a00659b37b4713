//! Damaged files.

use super::*;

/// Files of a few kilobytes in both forms.
const SMALL: [&str; 6] = [
    "apart.usda",
    "transforms.usda",
    "apart.usdc",
    "apart.usdz",
    "many.usdc",
    "pinned-catmull-rom.usdc",
];

/// Reads damaged bytes. Points cannot be more than the file may hold.
fn survives(bytes: &[u8], context: std::fmt::Arguments<'_>) {
    for frame in parse(bytes).into_iter().flatten() {
        if let Ok(set) = frame.curves {
            assert!(set.points() <= bytes.len(), "{context}");
            assert!(set.max_abs().is_finite(), "{context}");
        }
    }
}

#[test]
fn no_panic_on_truncated_files() {
    for name in SMALL {
        let bytes = std::fs::read(sample(name)).unwrap();
        assert!(!parse(&bytes).unwrap().is_empty());
        for n in 0..bytes.len() {
            survives(&bytes[..n], format_args!("{name}, {n} bytes"));
        }
    }
}

#[test]
fn no_panic_on_one_wrong_byte_anywhere() {
    for name in ["apart.usda", "apart.usdc", "many.usdc"] {
        let mut bytes = std::fs::read(sample(name)).unwrap();
        for at in 0..bytes.len() {
            let valid = bytes[at];
            // Each bit, and characters that open, end or continue something.
            let bits = (0..8).map(|k| valid ^ 1 << k);
            for value in bits.chain([0, 255, b'"', b'(', b'[', b'}', b'@', b'#', b'9', b'.']) {
                bytes[at] = value;
                survives(&bytes, format_args!("{name}, byte {at} = {value}"));
            }
            bytes[at] = valid;
        }
    }
}

#[test]
fn deep_nesting_does_not_overflow_the_stack() {
    let deep = |open: &str, close: &str| {
        let n = 100_000;
        format!(
            "#usda 1.0\ndef \"a\" {{ int[] x = {}{} }}",
            open.repeat(n),
            close.repeat(n)
        )
    };
    for (open, close) in [("[", "]"), ("(", ")"), ("{", "}")] {
        assert!(error(&deep(open, close)).contains("no BasisCurves"));
        assert!(error(&deep(open, "")).contains("does not end"));
    }
    let prims = format!(
        "#usda 1.0\n{}{}",
        "def \"a\" {".repeat(100_000),
        "}".repeat(100_000)
    );
    assert!(error(&prims).contains("no BasisCurves"));
}
