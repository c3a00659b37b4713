//! Compares the schema text, its compiled form and the structs.

use super::messages::*;
use prost::Message;
use prost::bytes::Bytes;
use prost_reflect::{DescriptorPool, DynamicMessage, Kind, ReflectMessage, Value};
use std::path::Path;

/// Name of the variable that requests to write the compiled schema: `LINKWATCH_WRITE_SCHEMA=1 cargo
/// test --lib schema`.
const WRITE: &str = "LINKWATCH_WRITE_SCHEMA";

#[test]
fn the_compiled_schema_equals_the_text() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas");
    let set = protox::compile([folder.join("linkwatch.proto")], [&folder]).unwrap();
    // Comments and positions in the text are not part of the schema.
    let mut set = set;
    set.file.iter_mut().for_each(|f| f.source_code_info = None);
    let compiled = set.encode_to_vec();
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(folder.join("linkwatch.binpb"), &compiled).unwrap();
        return;
    }
    assert!(
        compiled == DESCRIPTORS,
        "schemas/linkwatch.binpb differs from schemas/linkwatch.proto; {WRITE}=1 writes it again"
    );
}

/// Encodes a struct in which no field has its default, and decodes it by the schema alone. Every
/// field of the schema must be present, without unknown fields, and encoding the result must give
/// the same bytes.
fn agrees<M>(name: &str, full: &M) -> DynamicMessage
where
    M: Message + Default + PartialEq + std::fmt::Debug,
{
    let pool = DescriptorPool::decode(DESCRIPTORS).unwrap();
    let descriptor = pool
        .get_message_by_name(&format!("{PACKAGE}.{name}"))
        .unwrap();
    let bytes = full.encode_to_vec();
    let read = DynamicMessage::decode(descriptor, bytes.as_slice()).unwrap();
    complete(&read);
    assert_eq!(read.encode_to_vec(), bytes, "{name}");
    assert!(M::decode(bytes.as_slice()).unwrap() == *full);
    // Compares the names: a derived struct prints `field: value` for each, in order.
    let debug = format!("{full:?}");
    for field in read.descriptor().fields() {
        assert!(
            debug.contains(&format!("{}: ", field.name())),
            "{name}: no field {} in {debug}",
            field.name()
        );
    }
    read
}

/// Asserts that every field is set, in nested messages too, and that no field is unknown.
fn complete(message: &DynamicMessage) {
    let name = message.descriptor().full_name().to_owned();
    assert_eq!(message.unknown_fields().count(), 0, "{name}");
    for field in message.descriptor().fields() {
        assert!(message.has_field(&field), "{name}.{}", field.name());
        if !matches!(field.kind(), Kind::Message(_)) {
            continue;
        }
        match message.get_field(&field).as_ref() {
            Value::Message(inner) => complete(inner),
            Value::List(list) => {
                for inner in list.iter().filter_map(Value::as_message) {
                    complete(inner);
                }
            }
            other => panic!("{name}.{}: {other:?}", field.name()),
        }
    }
}

fn place() -> PlaceMessage {
    PlaceMessage {
        segment_i: 1,
        segment_j: 2,
        x: 3.5,
        y: -4.5,
        z: 5.5,
        distance: 6.5,
    }
}

fn defect() -> DefectMessage {
    DefectMessage {
        i: 1,
        j: Some(2),
        kind: 3,
        place: Some(place()),
    }
}

#[test]
fn the_structs_equal_the_schema() {
    let frame = FrameMessage {
        seq: 1,
        time: 2.5,
        basis: 3,
        precision: 2,
        counts: vec![-5, 6],
        positions: Bytes::from_static(b"bits"),
        cuts: 7,
    };
    let read = agrees("CurveFrame", &frame);
    let counts = read.get_field_by_name("counts").unwrap();
    assert_eq!(counts.as_list().unwrap(), [Value::I32(-5), Value::I32(6)]);
    let report = ReportMessage {
        seq: 1,
        time: 2.5,
        verdict: 2,
        abort: true,
        changes: vec![ChangeMessage {
            i: 1,
            j: 2,
            expected: -3,
            found: 4,
            place: Some(place()),
        }],
        defects: vec![defect()],
        rejected: Some("because".into()),
        stats: Some(StatsMessage {
            curves: 1,
            segments: 2,
            open_curves: 3,
            repeated_vertices: 4,
            potential_links: 5,
            separated: 6,
            tests: 7,
            crossings: 8,
            overlaps: 9,
            refined: 10,
            exact: 11,
            unchecked: 12,
            extent: 13.5,
        }),
        events: vec![PullThroughMessage {
            i: 1,
            j: 2,
            segment_i: 3,
            segment_j: 4,
            fraction: 0.5,
            sign: -1,
            x: 6.5,
            y: 7.5,
            z: 8.5,
            lengths: 9.5,
        }],
        adopted: vec![LinkMessage {
            i: 1,
            j: 2,
            lambda: -3,
        }],
        unresolved: vec![PullThroughMessage {
            i: 2,
            j: 3,
            segment_i: 4,
            segment_j: 5,
            fraction: 0.25,
            sign: 1,
            x: 1.5,
            y: 2.5,
            z: 3.5,
            lengths: 4.5,
        }],
    };
    let progress = ProgressMessage {
        verified: 1,
        skipped: 2,
        rejected: 3,
        check_ns: 4,
        work: Some(WorkMessage {
            route: 1,
            blocks: 2,
            marked: 3,
            recertified: 4,
            recomputed: 5,
            searched: 6,
            reference_age: Some(7),
            disagreed: true,
            summed: 9,
        }),
    };
    agrees(
        "Verdict",
        &VerdictMessage {
            report: Some(report),
            progress: Some(progress),
        },
    );
    let link = LinkMessage {
        i: 1,
        j: 2,
        lambda: -3,
    };
    agrees(
        "Baseline",
        &BaselineMessage {
            curves: 1,
            links: vec![link],
            undefined: vec![defect()],
            origin: "first frame".into(),
        },
    );
}

#[test]
fn the_codes_equal_the_schema() {
    use crate::curve::{Basis, Precision};
    use crate::incremental::Route;
    use crate::verdict::{DefectKind, Verdict};
    let pool = DescriptorPool::decode(DESCRIPTORS).unwrap();
    let check = |name: &str, words: Vec<String>| {
        let e = pool.get_enum_by_name(&format!("{PACKAGE}.{name}")).unwrap();
        let mut values: Vec<_> = e.values().collect();
        values.sort_by_key(|v| v.number());
        assert_eq!(values.len(), words.len() + 1, "{name}");
        for (k, word) in words.iter().enumerate() {
            let value = values[k + 1].name().replace('_', "").to_lowercase();
            let expected = format!("{name}{word}").to_lowercase();
            assert_eq!((values[k + 1].number(), value), (k as i32 + 1, expected));
        }
    };
    let debug = |v: &dyn std::fmt::Debug| format!("{v:?}");
    check("Basis", Basis::ALL.iter().map(|v| debug(v)).collect());
    check(
        "Precision",
        [Precision::F32, Precision::F64]
            .iter()
            .map(|v| debug(v))
            .collect(),
    );
    check(
        "VerdictCode",
        Verdict::ALL.iter().map(|v| debug(v)).collect(),
    );
    check("Route", Route::ALL.iter().map(|v| debug(v)).collect());
    check(
        "DefectKind",
        DefectKind::ALL.iter().map(|v| debug(v)).collect(),
    );
}
