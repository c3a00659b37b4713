use super::state::Change;
use super::*;
use crate::engine::Certifier;
use crate::formats::Frames;
use crate::ingest::{Closing, CurveSource};
use mcap::records::op;
use std::io::Cursor;
use std::path::PathBuf;

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("recordings")
        .join(name)
}

/// Recordings of other programs: `recordings/others/write.py` describes their motion.
const OTHERS: [&str; 4] = ["scene.mcap", "json.mcap", "markers.mcap", "marker.mcap"];

fn other(name: &str) -> PathBuf {
    path("others").join(name)
}

fn frames(name: &str) -> Vec<ModelFrame> {
    let frames = Frames::open(&other(name), &ReadOptions::default()).unwrap();
    frames.map(Result::unwrap).collect()
}

/// Returns the messages with curves, and how to decode them.
fn messages(name: &str) -> Vec<(Decode, Vec<u8>)> {
    let mut container = Container::open(&other(name)).unwrap();
    let channels = Channels::find(&mut container).unwrap();
    container.go_to_start().unwrap();
    let mut messages = Vec::new();
    while let Some((_, content)) = container.next().unwrap() {
        if let container::Content::Message(channel, _, body) = content
            && let (_, Some(decode)) = &channels.channels[&channel]
        {
            messages.push((Arc::clone(decode), body.into()));
        }
    }
    messages
}

#[test]
fn recordings_of_other_programs_have_the_links_of_their_motion() {
    for name in OTHERS {
        let found = frames(name);
        assert_eq!(found.len(), 5, "{name}");
        for (k, frame) in found.into_iter().enumerate() {
            let mut set = frame.curves.unwrap();
            let closed = Closing::default().of_set(&set, CurveSource::default());
            if let Some(closed) = closed.unwrap() {
                set = closed;
            }
            assert_eq!(frame.info.seq, k as u64);
            assert!(
                (frame.info.time % 1.7e9 - 1.0 - 0.1 * k as f64).abs() < 1e-6,
                "{}",
                frame.info.time
            );
            let mut names: Vec<&str> = frame.info.labels.names.iter().map(String::as_str).collect();
            let counts: Vec<i32> = set.counts().collect();
            let expected: &[i32] = match k {
                0 => &[-12, -12, 4, 2],
                1 => &[-12, -12, 4],
                _ => &[-12, -12],
            };
            assert_eq!(counts, expected, "{name}, frame {k}");
            names.truncate(2);
            assert!(
                ["ring", "turned"]
                    .iter()
                    .zip(names)
                    .all(|(a, b)| b.starts_with(a))
            );
            let mut certifier = Certifier::default();
            let (certificate, _) = certifier.certify(&set);
            let linked = certificate.links.len();
            assert_eq!(linked, usize::from(k < 3), "{name}, frame {k}");
            // The rings of all files have the same points, up to rounding.
            let point = set.point(1, 5);
            let x = if k < 3 { 1.0 } else { 4.0 } + (150f64).to_radians().cos();
            assert!(
                (point[0] - x).abs() < 1e-12 && point[1].abs() < 1e-12,
                "{point:?}"
            );
        }
    }
}

#[test]
fn names_are_those_of_entities_and_markers() {
    let names = |name: &str| frames(name)[0].info.labels.names.clone();
    assert_eq!(names("scene.mcap"), ["ring", "turned", "rope", "spark"]);
    assert_eq!(
        names("markers.mcap"),
        ["ring/0", "turned/0", "rope/7", "spark/0"]
    );
}

fn on_topic(topic: Option<&str>) -> ReadOptions {
    ReadOptions {
        topic: topic.map(str::to_owned),
        ..ReadOptions::default()
    }
}

#[test]
fn other_files_are_refused_with_their_topics() {
    let fails = |path: &Path, topic: Option<&str>| {
        Frames::open(path, &on_topic(topic))
            .err()
            .unwrap()
            .to_string()
    };
    let e = fails(&path("squares.mcap"), None);
    assert!(
        e.contains("a recording of linkwatch, which `linkwatch replay` verifies"),
        "{e}"
    );
    let scene = other("scene.mcap");
    let e = fails(&scene, Some("/origin"));
    assert!(
        e.contains("topic /origin has messages of type \"foxglove.Point3\""),
        "{e}"
    );
    let e = fails(&scene, Some("/other"));
    let topics = "no topic /other; its topics: /origin (foxglove.Point3), \
                  /scene (foxglove.SceneUpdate)";
    assert!(e.contains(topics), "{e}");
    let frames = Frames::open(&scene, &on_topic(Some("/scene")));
    assert_eq!(frames.unwrap().count(), 5);
}

fn channels(list: &[(&str, &str, &str)]) -> Channels {
    let mut channels = Channels::default();
    for (id, (topic, schema, encoding)) in (0..).zip(list) {
        let schema = ((*schema).into(), Bytes::new());
        channels.add(id, (*topic).into(), Some(&schema), encoding);
    }
    channels
}

#[test]
fn a_file_with_several_topics_needs_a_choice() {
    let both = channels(&[
        ("/a", SCENE_UPDATE, "protobuf"),
        ("/b", MARKER_ARRAY, "cdr"),
        ("/b", MARKER, "cdr"),
        ("/c", "other", "cdr"),
    ]);
    let e = both.choose(None).unwrap_err().to_string();
    assert!(
        e.contains("several topics have curves: /a, /b; choose one of them (option `topic`)"),
        "{e}"
    );
    assert_eq!(both.choose(Some("/b")).unwrap(), "/b");
    let ros1 = channels(&[("/a", MARKER, "ros1")]);
    for topic in [None, Some("/a")] {
        let e = ros1.choose(topic).unwrap_err().to_string();
        assert!(e.contains("encoded as \"ros1\" is not read"), "{e}");
    }
    let e = channels(&[]).choose(None).unwrap_err().to_string();
    assert!(e.contains("it has no topics"), "{e}");
}

fn put(name: &str, lifetime: u64, x: f64) -> Change {
    let entity = state::Entity {
        namespace: name.into(),
        frame_id: "world".into(),
        lifetime,
        strips: vec![state::Strip {
            closed: false,
            points: vec![[x, 0.0, 0.0], [x, 1.0, 0.0]],
        }],
        others: Vec::new(),
    };
    Change::Put(name.into(), entity)
}

fn names(state: &State) -> Vec<String> {
    state
        .curves()
        .map_or_else(|_| Vec::new(), |(_, labels)| labels.names.clone())
}

fn update(changes: Vec<Change>) -> Update {
    Update {
        stamp: None,
        changes,
    }
}

#[test]
fn messages_add_replace_and_delete() {
    let mut state = State::default();
    state.begin(0);
    state
        .apply(update(vec![
            put("a", 0, 1.0),
            put("b", 5, 2.0),
            put("c", 0, 3.0),
        ]))
        .unwrap();
    assert_eq!(names(&state), ["a", "b", "c"]);
    assert!(state.is_changed_by(&update(vec![put("c", 0, 0.0)])));
    assert!(!state.is_changed_by(&update(vec![put("d", 0, 0.0)])));
    assert!(state.is_changed_by(&update(vec![Change::DeleteAll(None)])));
    // Entity "a" disappears after its lifetime. A replacement keeps its position in the order.
    state.begin(5);
    assert_eq!(names(&state), ["a", "b", "c"]);
    state.begin(6);
    state.apply(update(vec![put("a", 0, 7.0)])).unwrap();
    assert_eq!(names(&state), ["a", "c"]);
    assert_eq!(state.curves().unwrap().0.point(0, 0), [7.0, 0.0, 0.0]);
    state
        .apply(update(vec![Change::Delete("a".into())]))
        .unwrap();
    assert_eq!(names(&state), ["c"]);
    state
        .apply(update(vec![
            put("a", 0, 1.0),
            Change::DeleteAll(Some("c".into())),
        ]))
        .unwrap();
    assert_eq!(names(&state), ["a"]);
    state.apply(update(vec![Change::DeleteAll(None)])).unwrap();
    assert!(state.is_empty());
}

/// Regression test: if an entity got a second line, the name of its first line changed, so that
/// curve counted as gone.
#[test]
fn the_first_line_of_an_entity_keeps_its_name() {
    let with_lines = |name: &str, number: usize| {
        let Change::Put(name, mut entity) = put(name, 0, 1.0) else {
            panic!();
        };
        entity.strips = vec![entity.strips[0].clone(); number];
        update(vec![Change::Put(name, entity)])
    };
    let mut state = State::default();
    state.begin(0);
    for (name, number) in [("a", 1), ("b", 2), ("a", 2), ("b", 1), ("c", 0), ("c", 1)] {
        state.apply(with_lines(name, number)).unwrap();
    }
    assert_eq!(names(&state), ["a", "a/1", "b/0", "c"]);
    state
        .apply(update(vec![Change::Delete("a".into())]))
        .unwrap();
    state.apply(with_lines("a", 3)).unwrap();
    assert_eq!(names(&state), ["b/0", "c", "a", "a/1", "a/2"]);
}

#[test]
fn rejects_two_coordinate_systems_and_names_that_are_not_unique() {
    let mut state = State::default();
    state.begin(0);
    state.apply(update(vec![put("a", 0, 1.0)])).unwrap();
    let Change::Put(name, mut entity) = put("b", 0, 1.0) else {
        panic!();
    };
    entity.frame_id = "map".into();
    let moved = Change::Put(name, entity);
    let e = state.apply(update(vec![moved])).unwrap_err();
    assert!(
        e.contains("\"b\" is in the coordinate system \"map\", but \"a\" in \"world\""),
        "{e}"
    );
    state.apply(update(vec![put("bad\n", 0, 1.0)])).unwrap();
    assert!(state.curves().is_err());
    state
        .apply(update(vec![Change::DeleteAll(None), put("a", 0, f64::NAN)]))
        .unwrap();
    let e = state.curves().unwrap_err().to_string();
    assert!(e.contains("is NaN"), "{e}");
}

/// A file with messages of one channel, as they were logged.
fn file(content: (&str, &str), messages: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let text = |s: &str| [&(s.len() as u32).to_le_bytes()[..], s.as_bytes()].concat();
    let record = |opcode: u8, body: &[u8]| {
        [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
    };
    let (schema, encoding) = content;
    let schema = [&[1, 0][..], &text(schema), &text(encoding), &text("")].concat();
    let channel = [&[7, 0, 1, 0][..], &text("/a"), &text(encoding), &text("")].concat();
    let mut file = b"\x89MCAP0\r\n".to_vec();
    file.extend(record(op::SCHEMA, &schema));
    file.extend(record(op::CHANNEL, &channel));
    for (time, body) in messages {
        let header = [&[7, 0, 0, 0, 0, 0][..], &time.to_le_bytes(), &[0; 8]].concat();
        file.extend(record(op::MESSAGE, &[&header[..], body].concat()));
    }
    file.extend(record(op::DATA_END, &[0; 4]));
    file.extend(b"\x89MCAP0\r\n");
    file
}

/// Reads to the end or the first error.
fn read(bytes: &[u8]) -> (Vec<ModelFrame>, Option<String>) {
    let mut frames = Vec::new();
    let source = Container::new(Cursor::new(bytes)).and_then(|c| McapFrames::new(c, None));
    let mut source = match source {
        Ok(source) => source,
        Err(e) => return (frames, Some(e.to_string())),
    };
    loop {
        match source.next_frame() {
            Ok(Some(frame)) => frames.push(frame),
            Ok(None) => return (frames, None),
            Err(e) => return (frames, Some(e.to_string())),
        }
    }
}

fn scene_in_json(stamp: u64, ids: &[&str]) -> Vec<u8> {
    let points = serde_json::json!([{"x": 0, "y": 0, "z": 0}, {"x": 1, "y": 0.5, "z": 0}]);
    let entity = |id: &&str| {
        serde_json::json!({
            "id": id,
            "timestamp": {"sec": stamp, "nsec": 0},
            "lines": [{"type": 0, "points": points}],
        })
    };
    let entities: Vec<_> = ids.iter().map(entity).collect();
    serde_json::json!({"deletions": [], "entities": entities})
        .to_string()
        .into()
}

#[test]
fn messages_of_one_time_are_one_frame_unless_they_change_a_curve_again() {
    let count = |messages: &[(u64, u64, &[&str])]| {
        let messages: Vec<_> = messages
            .iter()
            .map(|(log, stamp, ids)| (*log, scene_in_json(*stamp, ids)))
            .collect();
        let (frames, e) = read(&file((SCENE_UPDATE, "json"), &messages));
        assert_eq!(e, None);
        let curves = |f: &ModelFrame| (f.info.time, f.curves.as_ref().unwrap().len());
        frames.iter().map(curves).collect::<Vec<_>>()
    };
    // The time of the message counts if it has one, else that of the log.
    assert_eq!(
        count(&[(1, 9, &["a"]), (2, 9, &["b"]), (3, 10, &["a"])]),
        [(9.0, 2), (10.0, 2)]
    );
    let second = 1_000_000_000;
    assert_eq!(
        count(&[
            (second, 0, &["a"]),
            (second, 0, &["b"]),
            (2 * second, 0, &["c"])
        ]),
        [(1.0, 2), (2.0, 3)]
    );
    // If all messages have the same time, each change of a curve is a frame.
    assert_eq!(
        count(&[(1, 9, &["a"]), (2, 9, &["a"]), (3, 9, &["b"])]),
        [(9.0, 1), (9.0, 2)]
    );
    // Nothing to verify before the first curve.
    assert_eq!(count(&[(1, 0, &[]), (2, 0, &["a"])]).len(), 1);
}

/// Returns a scene update whose entity has a line, if it is to have one, and other elements.
fn with_others(line: bool, others: serde_json::Value) -> Vec<u8> {
    let mut scene: serde_json::Value = serde_json::from_slice(&scene_in_json(1, &["a"])).unwrap();
    let entity = &mut scene["entities"][0];
    if !line {
        entity["lines"] = serde_json::json!([]);
    }
    for (key, value) in others.as_object().unwrap() {
        entity[key] = value.clone();
    }
    scene.to_string().into()
}

#[test]
fn cylinders_beside_lines_are_counted_and_other_shapes_are_no_curves() {
    let others = serde_json::json!({"cylinders": [{}, {}], "spheres": [{}], "cubes": null});
    let scene = with_others(true, others);
    let (frames, e) = read(&file((SCENE_UPDATE, "json"), &[(1, scene)]));
    assert_eq!((frames.len(), e), (1, None));
    assert_eq!(frames[0].curves.as_ref().unwrap().len(), 1);
    let says = "not read, so not verified: 2 cylinders (the first one: \"a\")";
    assert_eq!(LeftOut::sentence(&frames[0].info.left_out), says);
    let shapes = with_others(true, serde_json::json!({"spheres": [{}], "texts": [{}]}));
    let (frames, _) = read(&file((SCENE_UPDATE, "json"), &[(1, shapes)]));
    assert_eq!(frames[0].info.left_out, []);
    // In protobuf: an entity (field 2) with an empty cylinder (field 10) and a sphere (field 9).
    let update = scene::protobuf(&[0x12, 4, 0x52, 0, 0x4a, 0]).unwrap();
    let Change::Put(_, entity) = &update.changes[0] else {
        panic!();
    };
    assert_eq!(
        entity.others[..],
        [(["sphere", "spheres"], 1), (state::CYLINDER, 1)]
    );
}

#[test]
fn a_file_without_lines_says_what_it_has_and_how_to_publish_lines() {
    let scene = with_others(
        false,
        serde_json::json!({"cylinders": [{}], "spheres": [{}]}),
    );
    let (frames, e) = read(&file((SCENE_UPDATE, "json"), &[(1, scene)]));
    let e = e.unwrap();
    assert_eq!(frames.len(), 0);
    let says = "no lines on topic /a: only cylinders, spheres, which are not read; publish each";
    assert!(e.contains(says) && e.contains("LINE_STRIP"), "{e}");
    let (_, e) = read(&file((SCENE_UPDATE, "json"), &[]));
    assert!(
        e.unwrap()
            .contains("its messages are empty, or it has none")
    );
}

#[test]
fn topics_with_lines_of_other_types_are_counted() {
    let left_out = |list: &[(&str, &str, &str)]| channels(list).left_out();
    let paths = [
        ("/a", MARKER_ARRAY, "cdr"),
        ("/path", "nav_msgs/msg/Path", "cdr"),
        ("/old", "visualization_msgs/Marker", "ros1"),
        ("/scene", SCENE_UPDATE, "flatbuffer"),
        ("/tf", "tf2_msgs/msg/TFMessage", "cdr"),
    ];
    let says = "3 topics that may have lines (the first one: /old (visualization_msgs/Marker))";
    let found = left_out(&paths);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].to_string(), says);
    assert_eq!(left_out(&[paths[0], paths[4]]), []);
}

#[test]
fn a_frame_without_curves_is_invalid_and_later_ones_are_read() {
    let all = br#"{"deletions": [{"type": 1}], "entities": []}"#.to_vec();
    let curve = |stamp| scene_in_json(stamp, &["a"]);
    let messages = [(1, curve(1)), (2, all), (3, curve(3))];
    let (frames, e) = read(&file((SCENE_UPDATE, "json"), &messages));
    assert_eq!((frames.len(), e), (3, None));
    let e = frames[1].curves.as_ref().unwrap_err().to_string();
    assert!(e.contains("no curves are left"), "{e}");
    assert!(frames[2].curves.is_ok());
}

#[test]
fn a_file_that_was_cut_off_gives_its_frames_and_then_an_error() {
    let messages: Vec<_> = (1..4).map(|k| (k, scene_in_json(k, &["a", "b"]))).collect();
    let whole = file((SCENE_UPDATE, "json"), &messages);
    let (frames, e) = read(&whole);
    assert_eq!((frames.len(), e), (3, None));
    for n in 0..whole.len() {
        let (found, e) = read(&whole[..n]);
        assert!(found.len() <= 3);
        // Only the end of the file may be missing without an error.
        assert!(e.is_some() || found.len() == 3, "{n} bytes");
    }
}

/// Bytes after the last message.
const END: usize = 9 + 4 + 8;

#[test]
fn the_last_frame_before_a_cut_is_kept_if_it_moved_every_curve() {
    let cut = |messages: &[(u64, Vec<u8>)]| {
        let whole = file((SCENE_UPDATE, "json"), messages);
        let (frames, e) = read(&whole[..whole.len() - END]);
        (frames.len(), e.unwrap())
    };
    let message = |k: u64, ids: &[&str]| (k, scene_in_json(k, ids));
    let mut messages = vec![message(1, &["a", "b"]), message(2, &["b", "a"])];
    let (frames, e) = cut(&messages);
    assert_eq!(frames, 2);
    assert!(e.contains("the file was cut off in "), "{e}");
    assert!(e.ends_with("; 2 frames before that were read"), "{e}");
    // The new position of "b" may be missing.
    messages.push(message(3, &["a"]));
    let (frames, e) = cut(&messages);
    assert_eq!(frames, 2);
    let says = "; 2 frames before that were read, but not the one at the end: messages of it may \
                be missing";
    assert!(e.ends_with(says), "{e}");
    messages.push(message(3, &["b", "c"]));
    assert_eq!(cut(&messages).0, 3);
    // Nothing says which curves were present in the first frame.
    let (frames, e) = cut(&messages[..1]);
    assert_eq!(frames, 0);
    assert!(
        e.contains("; 0 frames before that were read, but not"),
        "{e}"
    );
}

#[test]
fn the_last_frame_before_a_cut_is_not_kept_if_a_curve_is_missing() {
    let mut update: serde_json::Value = serde_json::from_slice(&scene_in_json(2, &["a"])).unwrap();
    let time = serde_json::json!({"sec": 2, "nsec": 0});
    update["deletions"] = serde_json::json!([{"type": 0, "id": "b", "timestamp": time}]);
    let update = update.to_string().into_bytes();
    let messages = [(1, scene_in_json(1, &["a", "b"])), (2, update)];
    let whole = file((SCENE_UPDATE, "json"), &messages);
    assert_eq!(read(&whole[..whole.len() - END]).0.len(), 1);
    assert_eq!(read(&whole).0.len(), 2);
}

#[test]
fn no_panic_on_one_wrong_byte_anywhere_in_a_file() {
    let messages: Vec<_> = (1..3).map(|k| (k, scene_in_json(k, &["a", "b"]))).collect();
    let whole = file((SCENE_UPDATE, "json"), &messages);
    for at in 0..whole.len() {
        for value in [0, 1, 0x7f, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] = value;
            assert!(read(&bytes).0.len() <= 2, "byte {at} = {value}");
        }
    }
}

fn points(update: &Update) -> usize {
    let count = |change: &Change| match change {
        Change::Put(_, entity) => entity.strips.iter().map(|s| s.points.len()).sum(),
        _ => 0,
    };
    update.changes.iter().map(count).sum()
}

#[test]
fn no_panic_on_messages_truncated_anywhere_or_with_one_wrong_byte() {
    for name in OTHERS {
        for (decode, bytes) in messages(name) {
            let whole = decode(&bytes).unwrap();
            assert!(points(&whole) <= 32);
            for n in 0..bytes.len() {
                if let Ok(update) = decode(&bytes[..n]) {
                    assert!(points(&update) <= 32, "{name}, {n} bytes");
                }
            }
            for at in 0..bytes.len() {
                for value in [0, 1, 4, 0x7f, 0x80, bytes[at] ^ 1, bytes[at] ^ 0x40, 0xff] {
                    let mut bytes = bytes.clone();
                    bytes[at] = value;
                    if let Ok(update) = decode(&bytes) {
                        assert!(
                            points(&update) <= bytes.len(),
                            "{name}, byte {at} = {value}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn a_message_whose_markers_have_other_fields_is_an_error() {
    let (_, bytes) = messages("markers.mcap").swap_remove(0);
    let foxy = Layout::of(b"string text");
    assert!(markers::read(&bytes, foxy, true).is_err());
    let humble = "string texture_resource\nMeshFile mesh_file";
    let (_, bytes) = messages("marker.mcap").swap_remove(0);
    let humble = Layout::of(humble.as_bytes());
    assert!(markers::read(&bytes, humble, false).is_err());
}
