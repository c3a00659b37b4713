//! Generates the files that follow from `schemas/linkwatch.proto`: its compiled form, which every
//! recording carries, and the Rust structs of its messages.
//!
//! `cargo run -p schemas` writes them; `cargo test -p schemas` compares them with those committed.

use prost::Message;
use std::error::Error;
use std::path::{Path, PathBuf};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// First lines of the generated code.
const HEADER: &str = "\
// Generated from schemas/linkwatch.proto by `cargo run -p schemas`. Do not edit.
";

/// Returns the path and the content of each generated file.
fn generate() -> Result<[(PathBuf, Vec<u8>); 2]> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .canonicalize()?;
    let folder = root.join("schemas");
    let mut set = protox::compile([folder.join("linkwatch.proto")], [&folder])?;
    let module = prost_build::Module::from_protobuf_package_name(set.file[0].package());
    let mut config = prost_build::Config::new();
    // Positions are written from a buffer that is reused.
    config.bytes(["CurveFrame.positions"]);
    let code = config.generate(vec![(module.clone(), set.file[0].clone())])?;
    let code = format!("{HEADER}{}", code[&module]);
    // Comments and positions in the text are not part of the schema.
    set.file.iter_mut().for_each(|f| f.source_code_info = None);
    Ok([
        (folder.join("linkwatch.binpb"), set.encode_to_vec()),
        (root.join("src/sinks/recording/schema.rs"), code.into()),
    ])
}

fn main() -> Result<()> {
    for (path, content) in generate()? {
        std::fs::write(&path, content)?;
        println!("wrote {}", path.display());
    }
    Ok(())
}

#[test]
fn the_committed_files_follow_from_the_schema() {
    for (path, content) in generate().unwrap() {
        let committed = std::fs::read(&path).unwrap();
        let path = path.display();
        assert!(
            committed == content,
            "{path} does not follow from linkwatch.proto; `cargo run -p schemas` writes it again"
        );
    }
}
