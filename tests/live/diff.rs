//! `linkwatch diff`: verdicts of two runs.

use super::recordings::rewrite_flight;
use super::written::{Chainmail, drop_verdicts};
use super::*;
use linkwatch::Events;

fn chainmail(pulled: u64) -> Chainmail {
    Chainmail {
        scene: "chainmail:rows=3,columns=3".into(),
        frames: 12,
        pulled,
        released: u64::MAX,
    }
}

fn diff(a: &Path, b: &Path, args: &[&str]) -> Ended {
    run_with("diff", a, &[&[b.to_str().unwrap()], args].concat())
}

#[test]
fn names_the_frame_at_which_the_runs_diverge_and_the_findings_that_only_one_has() {
    let folder = TempDir::new().unwrap();
    let [a, b] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    chainmail(8).record(&a, Events::Between, true);
    chainmail(u64::MAX).record(&b, Events::Between, true);
    let ended = diff(&a, &b, &[]);
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let found = &ended.lines[0]["diff"];
    let counts = ["compared", "different"].map(|name| found[name].as_u64().unwrap());
    assert_eq!(counts, [12, 4]);
    assert_eq!(found["curves"]["first"], serde_json::json!([8, 8]));
    assert_eq!(found["curves"]["equal"], 8);
    let first = &found["first"];
    assert_eq!(first["seq"], serde_json::json!([8, 8]));
    let verdicts = &first["difference"]["verdicts"];
    assert_eq!(*verdicts, serde_json::json!(["changed", "intact"]));
    let [only_a, only_b] = [0, 1].map(|k| first["difference"]["only"][k].as_array().unwrap());
    assert!(only_a[0].as_str().unwrap().contains("(ring/"), "{only_a:?}");
    assert!(
        only_a
            .iter()
            .any(|f| f.as_str().unwrap().contains("passed through"))
    );
    assert_eq!(only_b.len(), 0);

    let (code, text) = printed(&["diff", a.to_str().unwrap(), b.to_str().unwrap()]);
    assert_eq!(code, Some(1));
    for words in [
        "verdicts: 8 equal, 4 different",
        "first difference: frame 8",
        "only here: curves ",
        "curves: the runs diverge at frame 8; 8 of 12 frames are bitwise equal",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[test]
fn equal_runs_have_no_difference_and_a_part_of_one_is_incomplete() {
    let folder = TempDir::new().unwrap();
    let [a, b] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    chainmail(8).record(&a, Events::Off, true);
    chainmail(8).record(&b, Events::Off, true);
    let ended = diff(&a, &b, &[]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.lines[0]["diff"]["compared"], 12);
    let whole = std::fs::read(&b).unwrap();
    std::fs::write(&b, &whole[..whole.len() / 2]).unwrap();
    let ended = diff(&a, &b, &[]);
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("b.mcap: the recording was cut off"),
        "{}",
        ended.stderr
    );
    let found = &ended.lines[0]["diff"];
    let (compared, only) = (&found["compared"], &found["only"][0]["frames"]);
    assert_eq!(
        compared.as_u64().unwrap() + only.as_u64().unwrap(),
        12,
        "{found}"
    );
    // Damage is an error that names its file.
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    std::fs::write(&b, damaged).unwrap();
    for (first, second) in [(&a, &b), (&b, &a)] {
        let ended = diff(first, second, &[]);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(
            ended.stderr.contains("b.mcap: not a valid recording"),
            "{}",
            ended.stderr
        );
    }
    drop_verdicts(&a);
    std::fs::write(&b, whole).unwrap();
    let ended = diff(&a, &b, &[]);
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let found = &ended.lines[0]["diff"];
    assert_eq!(
        (&found["compared"], &found["without_verdict"]),
        (&0.into(), &12.into())
    );
    assert_eq!(found["curves"]["equal"], 12);
}

#[test]
fn counts_frames_that_one_run_lacks() {
    let folder = TempDir::new().unwrap();
    let gappy = folder.path().join("gappy.mcap");
    rewrite_flight(&gappy, |report| report.seq != 2);
    let ended = diff(&recordings().join("flight.mcap"), &gappy, &[]);
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let found = &ended.lines[0]["diff"];
    assert_eq!(
        found["only"][0],
        serde_json::json!({ "frames": 1, "range": [2, 2] })
    );
    assert_eq!(found["only"][1]["frames"], 0);
    assert_eq!(found["compared"], 4);
}

#[test]
fn refuses_files_that_cannot_be_compared() {
    let folder = TempDir::new().unwrap();
    let flight = recordings().join("flight.mcap");
    let linked = folder.path().join("linked.mcap");
    #[cfg(unix)]
    std::os::unix::fs::symlink(&flight, &linked).unwrap();
    let text = folder.path().join("text.mcap");
    std::fs::write(&text, "hello").unwrap();
    for (other, words) in [
        (&flight, "both are the same file"),
        #[cfg(unix)]
        (&linked, "both are the same file"),
        (&text, "not an MCAP file"),
        (&folder.path().join("none.mcap"), "none.mcap"),
        (
            &recordings().join("chainmail.mcap"),
            "different scenes: 2 curves in frame 0",
        ),
    ] {
        let ended = diff(&flight, other, &[]);
        assert_eq!(ended.code, Some(2), "{other:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(words), "{other:?}: {}", ended.stderr);
    }
}
