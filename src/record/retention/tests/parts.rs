//! Recordings in several files.

use super::*;

/// Records frames of about 108 kB in several files.
fn record_files(options: RecordingOptions, frames: u64, violations: &[u64]) -> String {
    let mut sink = options.open().unwrap();
    sink.begin(&baseline(3000)).unwrap();
    for seq in 0..frames {
        let changed = violations.contains(&seq).then_some(1);
        sink.frame(&frame(seq, 3000, changed)).unwrap();
    }
    let note = sink.note().unwrap();
    sink.finish().unwrap();
    note
}

#[test]
fn files_stay_below_the_maximum_size_and_replay_by_themselves() {
    for retention in [Retention::All, every(3)] {
        let folder = TempDir::new().unwrap();
        let mut options = options(&folder, retention);
        options.max_bytes = Some(1_000_000);
        let note = record_files(options, 60, &[13, 40]);
        let files = names(&folder);
        assert!(files.len() >= 3, "{files:?}");
        assert!(note.contains(&format!("{} files", files.len())), "{note}");
        let mut all = Vec::new();
        for number in 1..=files.len() as u64 {
            let path = part_of(&folder.path().join("run.mcap"), number);
            assert!(std::fs::metadata(&path).unwrap().len() <= 1_000_000);
            let content = read(&path);
            assert_eq!((content.missing, content.baselines.len()), (0, 1));
            assert_eq!(content.baselines[0].0, content.seqs()[0]);
            // A replay of a violation needs the frame before it.
            for violation in [13, 40] {
                let seqs = content.with_curves();
                let has = |seq: u64| seqs.contains(&seq);
                assert_eq!(has(violation), has(violation) && has(violation - 1));
            }
            let part = (number > 1).then(|| number.to_string());
            assert_eq!(content.metadata.get("part"), part.as_ref());
            all.extend(content.seqs());
        }
        assert_eq!(all, (0..60).collect::<Vec<_>>());
    }
}

#[test]
fn a_frame_that_is_larger_than_the_maximum_has_a_file_of_its_own() {
    let folder = TempDir::new().unwrap();
    let mut options = options(&folder, Retention::All);
    options.max_bytes = Some(1_000_000);
    let mut sink = options.clone().open().unwrap();
    for seq in 0..3 {
        sink.frame(&frame(seq, 40_000, Some(1))).unwrap();
    }
    sink.finish().unwrap();
    assert_eq!(names(&folder).len(), 3);
    options.max_bytes = Some(1000);
    let e = options.open().err().unwrap().to_string();
    assert!(e.contains("1000 bytes are too small"), "{e}");
}

/// If the name of a later file is taken, a long recording must not end.
#[test]
fn later_files_skip_names_that_are_taken() {
    for overwrite in [false, true] {
        let folder = TempDir::new().unwrap();
        let mine = folder.path().join("run-part2.mcap");
        std::fs::write(&mine, "mine").unwrap();
        // With `overwrite`, another process reads it.
        let reader = std::fs::File::open(&mine).unwrap();
        super::super::super::file::share(&reader);
        let mut options = options(&folder, Retention::All);
        options.max_bytes = Some(1_000_000);
        options.overwrite = overwrite;
        record_files(options, 20, &[]);
        let expected = match cfg!(unix) || !overwrite {
            true => [
                "run-part2.mcap",
                "run-part3.mcap",
                "run-part4.mcap",
                "run.mcap",
            ],
            false => return,
        };
        assert_eq!(names(&folder), expected);
        assert_eq!(std::fs::read(&mine).unwrap(), b"mine");
        let third = read(&folder.path().join("run-part3.mcap"));
        assert_eq!(third.metadata["continues"], "run.mcap");
    }
    // The name that the user chose is not replaced by another one.
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("run.mcap"), "mine").unwrap();
    assert!(options(&folder, Retention::All).open().is_err());
}
