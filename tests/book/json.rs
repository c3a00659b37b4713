//! Checks the fields in `docs/reference/json.md` against the output of the command.

use super::Page;
use super::support::{command, linkwatch, text};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Stdio;

/// Objects that no scene of this test produces.
const ABSENT: [&str; 1] = ["loop pair"];

/// Object with these additional fields.
const FRAME_OF_A_MODEL: &str = "frame of a model";
const OF_A_MODEL: [&str; 6] = [
    "certified frame",
    "diagram",
    "integral",
    "measured frame",
    "ribbon",
    "writhe",
];

/// Type of a field.
#[derive(Clone, Debug, PartialEq)]
enum Type {
    Boolean,
    Integer,
    Number,
    Text,
    /// An object or a list that the page describes in words.
    Any,
    Object(String),
    List(Box<Type>, Option<usize>),
    OrNull(Box<Type>),
}

impl Type {
    fn parse(words: &str) -> Type {
        if let Some(of) = words.strip_suffix(" or null") {
            // In a list, the items may be null.
            return match of.strip_prefix("list of ") {
                Some("list" | "integer") | None => Type::OrNull(Type::parse(of).into()),
                Some(_) => Type::OrNull(Type::parse(of).into()),
            };
        }
        if let Some(of) = words.strip_prefix("list of ") {
            return Type::List(Type::parse(of).into(), None);
        }
        if let Some((count, of)) = words.split_once(' ')
            && let Ok(count) = count.parse()
        {
            return Type::List(Type::parse(of.trim_end_matches('s')).into(), Some(count));
        }
        match words {
            "boolean" => Type::Boolean,
            "integer" => Type::Integer,
            "number" => Type::Number,
            "text" => Type::Text,
            "object" | "list" => Type::Any,
            name => Type::Object(name.to_owned()),
        }
    }
}

#[derive(Clone)]
struct Field {
    kind: Type,
    optional: bool,
}

/// The documented objects, and which of their fields occurred in the output.
struct Schema {
    objects: BTreeMap<String, BTreeMap<String, Field>>,
    seen: BTreeSet<(String, String)>,
}

impl Schema {
    fn read() -> Schema {
        let page = Page::read(Path::new("docs/reference/json.md"));
        let mut objects = BTreeMap::<String, BTreeMap<String, Field>>::new();
        let mut name = String::new();
        let rows = page
            .prose
            .lines()
            .skip_while(|l| !l.starts_with("| object |"));
        for row in rows.filter(|row| row.starts_with('|')) {
            let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
            let [object, fields, words, meaning] = cells[..] else {
                panic!("not four columns: {row}");
            };
            if object == "object" || object.starts_with("--") {
                continue;
            }
            assert!(!meaning.is_empty(), "{row}");
            if !object.is_empty() {
                name = object.trim_matches('*').to_owned();
                assert!(!objects.contains_key(&name), "twice: {name}");
            }
            let (words, optional) = match words.strip_suffix(", optional") {
                Some(words) => (words, true),
                None => (words, false),
            };
            let of = objects.entry(name.clone()).or_default();
            for field in fields.split(", ") {
                let kind = Type::parse(words);
                let field = field.trim_matches('`').to_owned();
                assert!(
                    of.insert(field, Field { kind, optional }).is_none(),
                    "twice: {row}"
                );
            }
        }
        let common = objects.remove(FRAME_OF_A_MODEL).expect("on the page");
        for name in OF_A_MODEL {
            let of = objects.get_mut(name).expect("on the page");
            of.extend(common.clone());
        }
        Schema {
            objects,
            seen: BTreeSet::new(),
        }
    }

    /// Compares an object of the output with the page.
    fn object(&mut self, name: &str, found: &Value, at: &str) {
        let object = found.as_object();
        let object = object.unwrap_or_else(|| panic!("{at}: not an object: {found}"));
        let fields = self.objects.get(name);
        let fields = fields.unwrap_or_else(|| panic!("{at}: not on the page: object {name}"));
        let missing = fields
            .iter()
            .filter(|(field, of)| !of.optional && !object.contains_key(*field));
        let missing: Vec<_> = missing.map(|(field, _)| field).collect();
        assert!(
            missing.is_empty(),
            "{at}: no such field in {name}: {missing:?}"
        );
        let mut kinds = Vec::new();
        for (field, value) in object {
            let of = fields.get(field);
            let of = of.unwrap_or_else(|| panic!("{at}: not on the page: {name}.{field}: {value}"));
            kinds.push((field.clone(), of.kind.clone(), value));
        }
        for (field, kind, value) in kinds {
            self.value(&kind, value, &format!("{at}.{field}"));
            self.seen.insert((name.to_owned(), field));
        }
    }

    fn value(&mut self, kind: &Type, found: &Value, at: &str) {
        let fits = match kind {
            Type::Boolean => found.is_boolean(),
            Type::Integer => found.is_i64() || found.is_u64(),
            Type::Number => found.is_number(),
            Type::Text => found.is_string(),
            Type::Any => found.is_object() || found.is_array(),
            Type::Object(name) => return self.object(name, found, at),
            Type::OrNull(kind) if !found.is_null() => return self.value(kind, found, at),
            Type::OrNull(_) => true,
            Type::List(kind, count) => {
                let items = found.as_array();
                let items = items.unwrap_or_else(|| panic!("{at}: not a list: {found}"));
                for item in items {
                    // Items may be null where the page says so about the list.
                    if !item.is_null() {
                        self.value(kind, item, at);
                    }
                }
                count.is_none_or(|count| items.len() == count)
            }
        };
        assert!(fits, "{at}: not {kind:?}: {found}");
    }

    /// Runs the command, and compares its lines with an object.
    fn run(&mut self, name: &str, args: &[&str]) {
        let run = linkwatch(&[args, &["--json", "-q"]].concat());
        assert!([0, 1, 3].contains(&run.code), "{args:?}: {}", run.stderr);
        self.lines(name, &run.stdout, &args.join(" "));
    }

    fn lines(&mut self, name: &str, stdout: &str, at: &str) {
        assert!(!stdout.is_empty(), "{at}: no output");
        for line in stdout.lines() {
            let found: Value = serde_json::from_str(line).unwrap();
            match (&found["summary"], name) {
                (_, "run of a file") => self.object(name, &found, at),
                (summary @ Value::Object(_), "answer") => {
                    self.object("publication", summary, at);
                }
                (summary @ Value::Object(_), _) => self.object("summary", summary, at),
                _ => self.object(name, &found, at),
            }
        }
    }
}

/// Two squares that share a point, and a third one through the first.
const TOUCHING: &str = "-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n\n1 0 0\n3 0 0\n3 0 1\n1 0 1\n\n\
    0 0 -1\n-2 0 -1\n-2 0 1\n0 0 1\n";

/// Borromean rings, the first one moved, and a torus knot of two strands.
fn knots(apart: f64, twists: f64) -> String {
    let mut lines = String::new();
    for turn in 0..3 {
        for [x, y] in [[-1.0, -2.0], [1.0, -2.0], [1.0, 2.0], [-1.0, 2.0]] {
            let mut p = [x, y, 0.0];
            p.rotate_right(turn);
            let z = if turn == 0 { p[2] + apart } else { p[2] };
            lines += &format!("{} {} {z}\n", p[0], p[1]);
        }
        lines += "\n";
    }
    for k in 0..60 {
        let t = f64::from(k) * std::f64::consts::TAU / 60.0;
        let r = 2.0 + (twists * t).cos();
        let (x, y, z) = (r * (2.0 * t).cos(), r * (2.0 * t).sin(), (twists * t).sin());
        lines += &format!("{} {y} {z}\n", x + 20.0);
    }
    lines
}

#[test]
fn the_page_has_the_fields_of_the_output() {
    let mut schema = Schema::read();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    let [sheet, cert, run, other, touching] = [
        "sheet.npz",
        "cert.txt",
        "run.mcap",
        "other.mcap",
        "touching.txt",
    ]
    .map(path);
    std::fs::write(&touching, TOUCHING).unwrap();
    // A face and a curve of a kind that is not read.
    let partial = path("partial.obj");
    let lines = "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3 1\ncurv2 1 2\n";
    std::fs::write(&partial, lines).unwrap();

    let scene = "chainmail:rows=2,columns=2";
    let moves = ["--frames", "6,pull=3,diameter=0.2", "-o", &sheet];
    let generate = [&["generate", scene][..], &moves, &["--certificate", &cert]].concat();
    schema.run("generated scene", &generate);
    schema.run("kind of scene", &["generate"]);
    schema.run(
        "frame",
        &["check", &sheet, "--events=all", "--record", &run],
    );
    schema.run(
        "frame",
        &[
            "check",
            &sheet,
            "--baseline",
            &cert,
            "--events=off",
            "--record",
            &other,
        ],
    );
    schema.run(
        "frame",
        &["check", &sheet, &partial, "--events", "--motion-limit", "0"],
    );
    schema.run("run of a file", &["check", "--each", &sheet]);
    let thick = ["replay", &run, "--radius", "0.5", "--min-clearance", "99%"];
    schema.run("frame", &thick);
    schema.run("comparison of runs", &["diff", &run, &other]);
    schema.run("run report", &["report", &run]);

    schema.run("certified frame", &["certify", &sheet, "--cell", "3,3,3"]);
    schema.run("certified frame", &["certify", &touching, "--closed"]);
    schema.run("certified frame", &["certify", &partial]);
    // Borromean rings come apart, and a trefoil comes undone.
    let (rings, apart) = (path("rings.txt"), path("apart.txt"));
    std::fs::write(&rings, knots(0.0, 3.0)).unwrap();
    std::fs::write(&apart, knots(9.0, 1.0)).unwrap();
    let invariants = ["--closed", "--invariants", "self,triple"];
    schema.run(
        "certified frame",
        &[&["certify", &rings][..], &invariants].concat(),
    );
    schema.run(
        "frame",
        &[&["check", &rings, &apart][..], &invariants].concat(),
    );
    schema.run("diagram", &["diagram", &rings, "--closed"]);
    schema.run("diagram", &["diagram", &touching, "--closed"]);
    schema.run("explanation", &["certify", &sheet, "--explain"]);
    schema.run(
        "integral",
        &["certify", &sheet, "--open", "--frame", "last"],
    );
    let thickness = [
        "measure",
        "thickness",
        &sheet,
        "--struts",
        "0.1",
        "--radius",
        "0.5",
        "--frame",
        "0",
    ];
    schema.run("measured frame", &thickness);
    schema.run("writhe", &["measure", "writhe", &sheet, "--frame", "0"]);
    let ribbon = "ribbon:segments=200,lambda=3";
    schema.run("ribbon", &["measure", "writhe", ribbon, "--ribbon", "0,1"]);
    schema.run("conversion", &["convert", &sheet, &path("converted.npz")]);

    // A live simulation.
    let service = format!("linkwatch-book-{}", std::process::id());
    let mut watch = command();
    watch.args([
        "watch",
        "--service",
        &service,
        "--radius",
        "0.5",
        "--wait",
        "60",
    ]);
    watch.args(["--keep-watching", "--events", "--json", "-q"]);
    let watch = watch.stdout(Stdio::piped()).spawn().unwrap();
    let publish = [
        "play",
        &run,
        "--service",
        &service,
        "--speed",
        "max",
        "--lockstep",
    ];
    schema.run("answer", &[&publish[..], &["--wait", "60"]].concat());
    schema.run("service", &["services"]);
    let id = watch.id().to_string();
    let signalled = std::process::Command::new("kill").arg(&id).status();
    assert!(signalled.unwrap().success());
    let watched = watch.wait_with_output().unwrap();
    schema.lines(
        "frame",
        &String::from_utf8(watched.stdout).unwrap(),
        "watch",
    );
    // Without an adapter there is no line.
    if cfg!(feature = "gpu") {
        let devices = linkwatch(&["devices", "--json", "-q"]);
        if !devices.stdout.is_empty() {
            schema.lines("device", &devices.stdout, "devices");
        }
    }

    let seen: BTreeSet<&str> = schema
        .seen
        .iter()
        .map(|(object, _)| object.as_str())
        .collect();
    let unseen = schema.objects.keys().map(String::as_str);
    let unseen: Vec<&str> = unseen
        .filter(|name| !seen.contains(name) && !ABSENT.contains(name) && *name != "device")
        .collect();
    assert!(
        unseen.is_empty(),
        "on the page, but not compared: {unseen:?}"
    );
}
