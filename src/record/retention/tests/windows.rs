//! Windows around violations.

use super::*;
use proptest::prelude::*;

fn window(folder: &TempDir, span: Duration, memory: u64) -> Box<Kept<Window>> {
    let files = Files::new(options(folder, Retention::All));
    Box::new(Kept::new(files, Window::new(span, memory)))
}

/// Takes a frame that arrived at a time.
fn take(window: &mut Kept<Window>, record: &FrameRecord, at: Duration) {
    let start = window.state.pass(record);
    let taken = window.keep.take(&mut window.files, record, start, at);
    taken.unwrap();
}

/// Records frames in windows. Each has a time in seconds, and the curve that is violated.
fn record_windows(
    folder: &TempDir,
    (span, memory): (f64, u64),
    frames: &[(f64, Option<u32>)],
) -> (Option<Content>, String) {
    let mut window = window(folder, Duration::from_secs_f64(span), memory);
    window.begin(&baseline(3)).unwrap();
    for (seq, (at, changed)) in frames.iter().enumerate() {
        let record = frame(seq as u64, 3, *changed);
        take(&mut window, &record, Duration::from_secs_f64(*at));
        let (bytes, waiting) = window.keep.memory();
        assert!(
            bytes <= memory || waiting == 1,
            "{bytes} in {waiting} frames"
        );
        if seq % 3 == 0 {
            while window.work().unwrap() {}
        }
    }
    let note = window.note().unwrap();
    window.finish().unwrap();
    let path = folder.path().join("run.mcap");
    (path.exists().then(|| read(&path)), note)
}

/// Frames that arrive once a second, of which some are violations that last one frame.
fn once_a_second(frames: u64, violations: &[u64]) -> Vec<(f64, Option<u32>)> {
    let changed = |seq: u64| violations.contains(&seq).then_some(1);
    (0..frames).map(|seq| (seq as f64, changed(seq))).collect()
}

#[test]
fn a_window_has_the_frames_before_and_after_a_violation() {
    let folder = TempDir::new().unwrap();
    let frames = once_a_second(100, &[20, 60, 64]);
    let (content, note) = record_windows(&folder, (5.0, MEMORY), &frames);
    let content = content.unwrap();
    assert_eq!(content.seqs(), (15..=25).chain(55..=69).collect::<Vec<_>>());
    assert_eq!(content.with_curves(), content.seqs());
    // Each window replays by itself, and no frame counts as lost.
    assert_eq!(content.baselines, [(15, 3), (55, 3)]);
    assert_eq!(content.missing, 0);
    assert!(
        note.contains("26 of 100 frames, around 2 violations"),
        "{note}"
    );
}

/// Regression test: the record of the first baseline ended the window too early.
#[test]
fn a_window_of_a_rejected_first_frame_has_the_frames_after_it() {
    let folder = TempDir::new().unwrap();
    let mut window = window(&folder, Duration::from_secs(60), MEMORY);
    let mut first = frame(0, 3, None);
    first.curves = None;
    Arc::make_mut(&mut first.report).verdict = Verdict::Rejected;
    take(&mut window, &first, Duration::ZERO);
    window.begin(&baseline(3)).unwrap();
    for seq in 1..8 {
        take(&mut window, &frame(seq, 3, None), Duration::from_secs(seq));
    }
    window.finish().unwrap();
    let content = read(&folder.path().join("run.mcap"));
    assert_eq!(content.seqs(), (0..8).collect::<Vec<_>>());
}

#[test]
fn no_file_is_written_without_a_violation() {
    let folder = TempDir::new().unwrap();
    let (content, note) = record_windows(&folder, (5.0, MEMORY), &once_a_second(100, &[]));
    assert_eq!((content, names(&folder).len()), (None, 0));
    assert!(
        note.contains("no violation in 100 frames, so no file"),
        "{note}"
    );
}

#[test]
fn a_violation_that_lasts_begins_one_window() {
    let folder = TempDir::new().unwrap();
    let mut frames = once_a_second(100, &[]);
    frames[20..].iter_mut().for_each(|frame| frame.1 = Some(1));
    // Another pair of curves.
    frames[70..].iter_mut().for_each(|frame| frame.1 = Some(2));
    let (content, _) = record_windows(&folder, (3.0, MEMORY), &frames);
    let expected: Vec<u64> = (17..=23).chain(67..=73).collect();
    assert_eq!(content.unwrap().seqs(), expected);
}

/// Regression test: the frame of the second violation was not recorded.
#[test]
fn curves_that_are_described_again_begin_new_violations() {
    let folder = TempDir::new().unwrap();
    let mut window = window(&folder, Duration::from_secs(1), MEMORY);
    window.begin(&baseline(3)).unwrap();
    for seq in 0..20 {
        let mut record = frame(seq, 3, (seq >= 3).then_some(1));
        record.info.layout = u32::from(seq >= 10);
        take(&mut window, &record, Duration::from_secs(seq));
    }
    let note = window.note().unwrap();
    window.finish().unwrap();
    let content = read(&folder.path().join("run.mcap"));
    assert_eq!(content.seqs(), [2, 3, 4, 9, 10, 11]);
    assert!(note.contains("around 2 violations"), "{note}");
}

#[test]
fn a_window_is_shorter_if_the_memory_is_too_small_and_says_so() {
    let folder = TempDir::new().unwrap();
    let frames = once_a_second(100, &[50]);
    // A frame of three triangles, with its record.
    let frame_bytes = 3 * 9 * 4 + 1024;
    let (content, note) = record_windows(&folder, (20.0, 4 * frame_bytes), &frames);
    let seqs = content.unwrap().seqs();
    assert_eq!((seqs[0], seqs.len()), (46, 25));
    assert!(note.contains("1 shorter before the violation"), "{note}");
    // The frame before a violation is kept in any case.
    let folder = TempDir::new().unwrap();
    let (content, _) = record_windows(&folder, (0.1, 1), &frames);
    assert_eq!(content.unwrap().seqs(), [49, 50]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Compares windows with their definition.
    #[test]
    fn windows_have_exactly_the_frames_near_violations(
        steps in proptest::collection::vec((0_u32..30, 0_u32..8), 1..120),
        span in 0_u32..60,
    ) {
        let mut at = 0;
        let frames: Vec<(f64, Option<u32>)> = steps
            .iter()
            .map(|(step, violated)| {
                at += step;
                (f64::from(at), (*violated == 0).then_some(1))
            })
            .collect();
        let folder = TempDir::new().unwrap();
        let (content, _) = record_windows(&folder, (f64::from(span), MEMORY), &frames);
        let is_new = |k: &usize| frames[*k].1.is_some() && (*k == 0 || frames[k - 1].1.is_none());
        let violations: Vec<usize> = (0..frames.len()).filter(is_new).collect();
        let near = |k: &usize| {
            violations.iter().any(|&v| {
                (frames[v].0 - frames[*k].0).abs() <= f64::from(span) || *k == v || *k + 1 == v
            })
        };
        let expected: Vec<u64> = (0..frames.len()).filter(near).map(|k| k as u64).collect();
        let content = content.unwrap_or_default();
        prop_assert_eq!(content.seqs(), expected);
        prop_assert_eq!(content.missing, 0);
    }
}

/// Curves appear in frame 5: a window after that has the new baseline and the new names, and one
/// before it the old ones.
#[test]
fn a_window_has_the_baseline_and_the_names_of_its_own_frames() {
    let folder = TempDir::new().unwrap();
    let mut window = window(&folder, Duration::from_secs(1), MEMORY);
    let labels = |curves: usize| {
        let names = (0..curves).map(|k| format!("curve {k}"));
        Arc::new(CurveLabels::named(names))
    };
    window.begin(&baseline(2)).unwrap();
    for seq in 0..20 {
        let curves = if seq < 5 { 2 } else { 3 };
        if seq == 5 {
            window.expect(&baseline(3)).unwrap();
        }
        let changed = [2, 10].contains(&seq).then_some(1);
        let mut record = frame(seq, curves, changed);
        record.info.labels = labels(curves);
        record.info.layout = u32::from(seq >= 5);
        take(&mut window, &record, Duration::from_secs(seq));
    }
    window.finish().unwrap();
    let content = read(&folder.path().join("run.mcap"));
    assert_eq!(content.seqs(), [1, 2, 3, 9, 10, 11]);
    assert_eq!(content.baselines, [(1, 2), (9, 3)]);
    assert_eq!(content.names[2].len(), 2);
    assert_eq!(content.names[3], labels(3).names);
}
