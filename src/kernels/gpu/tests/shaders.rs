//! Shaders are valid, and their structs have the layout of those in Rust. Needs no adapter.

use super::*;
use crate::kernels::gpu::layout::Parameters;

fn parsed(stage: &Stage) -> naga::Module {
    let source = (stage.source)();
    let parsed = naga::front::wgsl::parse_str(&source);
    parsed.unwrap_or_else(|e| panic!("{}: {}", stage.name, e.emit_to_string(&source)))
}

#[test]
fn all_shaders_are_valid_and_need_no_optional_feature_but_double_precision() {
    use naga::valid::Capabilities;
    let double = Capabilities::FLOAT64 | Capabilities::SHADER_INT64;
    let single = stages().into_iter().map(|s| (s, Capabilities::empty()));
    let all = single.chain(stages_in::<f64>().into_iter().map(|s| (s, double)));
    for (stage, needed) in all {
        let module = parsed(&stage);
        let flags = naga::valid::ValidationFlags::all();
        let valid = naga::valid::Validator::new(flags, needed).validate(&module);
        assert!(valid.is_ok(), "{}: {valid:?}", stage.name);
        let main = &module.entry_points[0];
        assert_eq!((module.entry_points.len(), &main.name[..]), (1, "main"));
        assert!(main.workgroup_size.iter().product::<u32>() <= 256);
    }
}

/// Compares a struct of the shaders with that of Rust.
fn same_layout(name: &str, size: usize, offsets: &[(&str, usize)]) {
    let mut seen = 0;
    for stage in stages().into_iter().chain(stages_in::<f64>()) {
        let module = parsed(&stage);
        for (_, ty) in module.types.iter() {
            let naga::TypeInner::Struct { members, span } = &ty.inner else {
                continue;
            };
            if ty.name.as_deref() != Some(name) {
                continue;
            }
            seen += 1;
            assert_eq!(*span as usize, size, "{name} in {}", stage.name);
            let theirs: Vec<(&str, usize)> = members
                .iter()
                .map(|m| (m.name.as_deref().unwrap_or(""), m.offset as usize))
                .collect();
            assert_eq!(theirs, offsets, "{name} in {}", stage.name);
        }
    }
    assert!(seen > 0, "no shader has {name}");
}

macro_rules! same_layout {
    ($name:ident: $($field:ident),+) => {
        same_layout(
            stringify!($name),
            size_of::<$name>(),
            &[$((stringify!($field), offset_of!($name, $field))),+],
        );
    };
}

#[test]
fn structs_have_the_same_layout_in_rust_and_in_shaders() {
    same_layout!(Parameters: radius, zero, first, items);
    same_layout!(Tile: pair, first_row, rows, first_column, columns, padding);
    same_layout!(BoxNode: low, first, high, below);
    same_layout!(Roots: first, count);
    same_layout!(Undecided: pair, upper, lower);
    same_layout!(
        Node: centre, radius, centre_rest, length, second, fourth, first, segments, tangents,
        right, leaf, moments, padding
    );
    same_layout!(NodePair: pair, first, second);
    same_layout!(Criterion: beta, share);
}
