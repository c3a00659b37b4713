//! Compares the tables of `docs/reference/bus.md`, and the numbers of `docs/reference/limits.md`,
//! with the code.

use crate::bus::frames::LOANS;
use crate::bus::message::{Counters, MessageKind};
use crate::bus::service::{
    Endpoint, FRAME_BORROWS, FRAME_BUFFER, FRAME_HISTORY, FRAME_SUBSCRIBERS, Role,
};
use crate::bus::sidecar::{BATCH, ENDED_SESSIONS, SidecarOptions};
use crate::bus::wait_mode::WaitMode;
use crate::bus::wire::{
    ALIGNMENT, FINDING_CHANGE, FINDING_DEFECT, FINDING_EVENT, FINDING_NONE, FLAG_ANNOUNCE,
    FLAG_BASELINE, FLAG_END, FLAG_LOCKSTEP, FLAG_RADII, FLAG_UNFINISHED, FRAME_MAGIC, FrameHeader,
    LAYOUT_VERSION, NO_CURVE, NO_FRAME, VERDICT_MAGIC, VerdictWire,
};
use crate::curve::{Basis, Precision};
use crate::verdict::{DefectKind, Verdict};
use iceoryx2::prelude::PortFactory;
use iceoryx2::service::static_config::publish_subscribe::StaticConfig;
use std::any::type_name_of_val;
use std::mem::{align_of, offset_of, size_of, size_of_val};

const PAGE: &str = include_str!("../../../docs/reference/bus.md");
const FORMATS: &str = include_str!("../../../docs/reference/formats.md");

/// Returns the rows of the first table after `heading` whose first column has this title, without
/// backticks.
fn rows(heading: &str, title: &str) -> Vec<Vec<String>> {
    rows_of(PAGE, heading, title)
}

fn rows_of(page: &str, heading: &str, title: &str) -> Vec<Vec<String>> {
    let (_, section) = page.split_once(heading).expect("the page has the heading");
    let start = format!("| {title} |");
    let mut lines = section.lines().skip_while(|l| !l.starts_with(&start));
    let table = lines.by_ref().take_while(|l| l.starts_with('|')).skip(2);
    let cells = |line: &str| {
        let inner = line.trim_matches('|').replace('`', "");
        inner
            .split('|')
            .map(|cell| cell.trim().to_owned())
            .collect()
    };
    table.map(cells).collect()
}

/// Returns the first `n` columns of these rows.
fn columns(n: usize, rows: Vec<Vec<String>>) -> Vec<Vec<String>> {
    rows.into_iter().map(|row| row[..n].to_vec()).collect()
}

/// Lists the offset, size, type and name of every field. Does not compile if a field is missing.
macro_rules! fields {
    ($value:expr, $struct:ident { $($field:ident),* $(,)? }) => {{
        let $struct { $($field),* } = $value;
        vec![$(vec![
            offset_of!($struct, $field).to_string(),
            size_of_val(&$field).to_string(),
            type_name_of_val(&$field).to_owned(),
            stringify!($field).to_owned(),
        ]),*]
    }};
}

fn codes<'a>(names: impl IntoIterator<Item = (u32, &'a str)>) -> Vec<Vec<String>> {
    let row = |(code, name): (u32, &str)| vec![code.to_string(), name.to_owned()];
    names.into_iter().map(row).collect()
}

#[test]
fn the_page_has_every_field_of_a_frame_header() {
    let header = FrameHeader::default();
    let expected = fields!(
        header,
        FrameHeader {
            magic,
            version,
            flags,
            session,
            seq,
            baseline,
            time,
            n_points,
            n_curves,
            basis,
            coordinate_bytes,
            cuts,
            layout,
            names_bytes,
            time_step,
            cell_vectors,
            reserved,
            cell_origin,
            cell,
        }
    );
    let found = rows("## A frame", "offset");
    assert_eq!(columns(4, found.clone()), expected);
    assert!(
        found[0][4].contains(&format!("{FRAME_MAGIC:#018x}")),
        "{}",
        found[0][4]
    );
    assert_eq!(found[1][4], LAYOUT_VERSION.to_string());
}

#[test]
fn the_page_has_every_field_of_a_verdict() {
    let hello = VerdictWire::new(MessageKind::Hello, 0, Counters::default());
    let expected = fields!(
        hello,
        VerdictWire {
            magic,
            version,
            kind,
            session,
            seq,
            time,
            verdict,
            abort,
            lost,
            gained,
            changed,
            defects,
            events,
            finding,
            i,
            j,
            defect_kind,
            segments,
            has_place,
            reason_len,
            unresolved,
            appeared,
            gone,
            findings,
            recovered,
            expected,
            found,
            point,
            distance,
            lengths,
            extent,
            verified,
            skipped,
            rejected,
            check_ns,
            last_intact,
            safe_fraction,
            image,
            reason,
        }
    );
    let found = rows("## A message", "offset");
    assert_eq!(columns(4, found.clone()), expected);
    assert!(
        found[0][4].contains(&format!("{VERDICT_MAGIC:#018x}")),
        "{}",
        found[0][4]
    );
    assert_eq!(found[1][4], LAYOUT_VERSION.to_string());
    let j = found.iter().find(|row| row[3] == "j").unwrap();
    assert!(j[4].contains(&NO_CURVE.to_string()), "{}", j[4]);
    let last = found.iter().find(|row| row[3] == "last_intact").unwrap();
    assert!(last[4].contains(&NO_FRAME.to_string()), "{}", last[4]);
    let alignment = align_of::<VerdictWire>();
    assert_eq!(align_of::<FrameHeader>(), alignment);
    let sizes = format!(
        "({} and {} bytes) and the alignment ({alignment} bytes for both)",
        size_of::<FrameHeader>(),
        size_of::<VerdictWire>(),
    );
    assert!(PAGE.contains(&sizes), "{sizes}");
    let version = format!("The version of this layout is **{LAYOUT_VERSION}**.");
    assert!(PAGE.contains(&version), "{version}");
}

#[test]
fn the_page_has_every_code() {
    let flags = [
        (FLAG_LOCKSTEP, "lockstep"),
        (FLAG_END, "end"),
        (FLAG_ANNOUNCE, "announce"),
        (FLAG_UNFINISHED, "unfinished"),
        (FLAG_RADII, "radii"),
        (FLAG_BASELINE, "baseline"),
    ];
    assert_eq!(columns(2, rows("## A frame", "flag")), codes(flags));

    let kinds = [
        MessageKind::Hello,
        MessageKind::Verdict,
        MessageKind::Goodbye,
    ];
    let kinds = kinds.map(|k| (k as u32, format!("{k:?}").to_lowercase()));
    let kinds = kinds.iter().map(|(code, name)| (*code, name.as_str()));
    assert_eq!(columns(2, rows("## A message", "kind")), codes(kinds));

    let verdicts = Verdict::ALL.map(|v| (v as u32, v.word()));
    assert_eq!(columns(2, rows("## A message", "verdict")), codes(verdicts));

    let findings = [
        (FINDING_NONE, "none"),
        (FINDING_CHANGE, "change"),
        (FINDING_DEFECT, "defect"),
        (FINDING_EVENT, "pull-through"),
    ];
    assert_eq!(columns(2, rows("## A message", "finding")), codes(findings));

    let json = |d| serde_json::to_value::<DefectKind>(d).unwrap();
    assert!(DefectKind::ALL.into_iter().all(|d| json(d) == d.word()));
    let defects = DefectKind::ALL.map(|d| (d as u32, d.word()));
    assert_eq!(columns(2, rows("## A message", "defect")), codes(defects));
}

#[test]
fn the_page_lists_the_numbers_of_points_of_each_basis() {
    let found = rows("## A frame", "basis code");
    assert_eq!(found.len(), Basis::ALL.len());
    for (basis, row) in Basis::ALL.into_iter().zip(found) {
        assert_eq!(row[0], basis.code().to_string());
        for (closed, cell) in [(true, &row[3]), (false, &row[4])] {
            let valid = (0..=10).filter(|&n| basis.segments(n, closed).is_some());
            let valid: Vec<String> = valid.map(|n| n.to_string()).collect();
            let expected = match basis {
                Basis::Bezier => format!("{}, ..", valid.join(", ")),
                _ => format!("{} or more", valid[0]),
            };
            assert_eq!(*cell, expected, "{basis:?}");
        }
    }
    let header = FrameHeader {
        n_curves: 2,
        n_points: 200,
        ..FrameHeader::default()
    };
    let example = header.payload_bytes(Precision::F32);
    assert!(PAGE.contains(&format!("2400 bytes of positions: {example} bytes.")));
}

/// Opens both services, and compares the settings that iceoryx2 reports.
#[test]
fn the_page_has_the_settings_of_both_services() {
    let name = format!("linkwatch-page-{}", std::process::id());
    let endpoint = Endpoint::open(&name, Role::Simulator, WaitMode::Sleep).unwrap();
    let of = |service: &StaticConfig| {
        let switch = if service.has_safe_overflow() {
            "on"
        } else {
            "off"
        };
        vec![
            (
                "payload alignment",
                service
                    .message_type_details()
                    .payload
                    .alignment()
                    .to_string(),
            ),
            ("maximum publishers", service.max_publishers().to_string()),
            ("maximum subscribers", service.max_subscribers().to_string()),
            (
                "subscriber buffer size",
                service.subscriber_max_buffer_size().to_string(),
            ),
            (
                "subscriber borrowed samples",
                service.subscriber_max_borrowed_samples().to_string(),
            ),
            ("history size", service.history_size().to_string()),
            ("safe overflow", switch.to_owned()),
        ]
    };
    let (frames, verdicts) = (
        endpoint.frames.static_config(),
        endpoint.verdicts.static_config(),
    );
    let expected: Vec<Vec<String>> = of(frames)
        .into_iter()
        .zip(of(verdicts))
        .map(|((setting, f), (_, v))| vec![setting.to_owned(), f, v])
        .collect();
    assert_eq!(rows("## Services", "setting"), expected);
    assert_eq!(frames.message_type_details().payload.alignment(), ALIGNMENT);
    let named = rows("## Services", "service");
    let header = frames
        .message_type_details()
        .user_header
        .type_name()
        .to_string();
    let verdict = verdicts
        .message_type_details()
        .payload
        .type_name()
        .to_string();
    assert_eq!((&named[0][5], &named[2][4]), (&header, &verdict));
}

/// For each basis, writes a BCC file as the pages describe it, and reads it.
#[test]
fn reads_files_written_by_the_page() {
    let offsets = columns(1, rows_of(FORMATS, "## BCC", "BCC offset"));
    assert_eq!(offsets.concat(), ["0", "4", "6", "8", "16", "24", "64"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.bcc");
    for (basis, row) in Basis::ALL.into_iter().zip(rows("## A frame", "basis code")) {
        let mut file = b"BCC\x44".to_vec();
        file.extend(row[1].as_bytes());
        file.extend([3, 0]);
        file.extend(1_u64.to_le_bytes());
        file.extend(3_u64.to_le_bytes());
        file.extend([0; 40]);
        file.extend((-3_i32).to_le_bytes());
        file.extend((0..9).flat_map(|x: u8| f32::from(x).to_le_bytes()));
        std::fs::write(&path, &file).unwrap();
        let set = crate::formats::read(&path).unwrap();
        assert_eq!(
            (set.basis(), set.counts().collect::<Vec<_>>()),
            (basis, vec![-3])
        );
        assert_eq!(set.point(0, 2), [6.0, 7.0, 8.0]);
    }
}

#[test]
fn the_client_in_python_has_the_fields_of_the_page() {
    const CLIENT: &str = include_str!("../../../examples/rings.py");
    assert!(CLIENT.contains(&format!("\nVERSION = {LAYOUT_VERSION}\n")));
    // `[f64; 3]` on the page is `f64*3` in the tables of the client.
    let in_python = |t: &str| t.trim_matches(['[', ']']).replace("; ", "*");
    for (class, heading) in [("FrameHeader", "## A frame"), ("Verdict", "## A message")] {
        let (_, class) = CLIENT.split_once(&format!("class {class}(")).unwrap();
        let table = class.split("\"\"\"").nth(1).unwrap();
        // A line has a type and names.
        let fields = table.lines().flat_map(|line| {
            let mut words = line.split_whitespace();
            let kind = words.next().unwrap_or_default();
            words.map(move |name| [name.to_owned(), kind.to_owned()])
        });
        let fields: Vec<[String; 2]> = fields.collect();
        let expected: Vec<[String; 2]> = rows(heading, "offset")
            .iter()
            .map(|row| [row[3].clone(), in_python(&row[2])])
            .collect();
        assert_eq!(fields, expected);
    }
}

#[test]
fn the_page_of_limits_has_those_of_the_code() {
    let page = include_str!("../../../docs/reference/limits.md");
    let frames = FRAME_SUBSCRIBERS * (FRAME_BUFFER + FRAME_BORROWS) + FRAME_HISTORY + LOANS;
    assert_eq!(SidecarOptions::default().max_frame_bytes, (4 << 30) - 1);
    assert_eq!(crate::SessionOptions::MAX_PAIRS, 33_554_432);
    for row in [
        "| a frame | 4 GiB (".to_owned(),
        "| pairs of curves whose boxes overlap | 33,554,432 (".to_owned(),
        format!("| messages read ahead from the bus | {BATCH} |"),
        format!("| ended sessions whose late frames are recognised | {ENDED_SESSIONS} |"),
        format!("| shared memory of the frames | {frames} frames"),
    ] {
        assert!(
            page.contains(&row),
            "not in docs/reference/limits.md: {row}"
        );
    }
}
