//! Uploads ahead of time, and the choice between CPU and GPU by a calibration.

use super::*;
use crate::{FrameInfo, Received, Session};

/// Returns an invented calibration of this adapter: see [`Calibration::made_up`].
fn made_up(round_trip_ms: f64, speed: f64) -> Calibration {
    let DeviceInfo {
        name,
        backend,
        driver,
        ..
    } = adapter().info();
    Calibration {
        adapter: name,
        backend,
        driver,
        ..Calibration::made_up(round_trip_ms, speed)
    }
}

#[test]
#[ignore = "needs an adapter"]
fn vertices_are_uploaded_once_and_during_the_previous_frame() {
    let gpu = adapter();
    let [now, next] = two_frames();
    let mut trees = Trees::default();
    trees.refit(&*now);
    let input = Input {
        set: &now,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let pairs = crate::pairs::LinkSearch::default()
        .find(trees.roots())
        .to_vec();
    let frame = Frame::new(&now);
    let (_, sent) = gpu.count(&frame, input, &pairs, Some(&next)).unwrap();
    let sent = sent.unwrap();
    let both = gpu.lock().vertices_of;
    assert!(both.contains(&Some(frame.id)) && both.contains(&Some(sent.id)));
    // Nothing else is uploaded for it.
    gpu.send(&sent).unwrap();
    let commands = boxes::fit(&mut gpu.lock(), &sent).concat();
    assert!(commands.is_empty() && gpu.lock().vertices_of == both);
}

#[test]
#[ignore = "needs an adapter"]
fn announcing_frames_changes_no_verdict() {
    let [first, second] = two_frames();
    let order = [&first, &second, &second, &first];
    let reports = |announce: bool| {
        let mut session = Session::new(SessionOptions {
            device: Device::Gpu,
            ..SessionOptions::default()
        })
        .unwrap();
        // The last announced frame is never verified.
        let frame = |k: usize| {
            let set = order.get(k).copied().unwrap_or(&second);
            Received::new(FrameInfo::at(k as u64, 0.0), Ok(Arc::clone(set)))
        };
        let step = |k: usize| {
            if announce {
                session.announce(&frame(k + 1));
            }
            let verified = session.verify(frame(k)).unwrap();
            assert!(verified.offload.tests > 0);
            verified.report
        };
        (0..order.len()).map(step).collect::<Vec<_>>()
    };
    assert_eq!(reports(true), reports(false));
}

#[test]
#[ignore = "needs an adapter"]
fn under_auto_the_adapter_is_used_if_its_calibration_predicts_a_gain() {
    let (wins, loses) = (made_up(1e-3, 1e6), made_up(1e3, 1e-3));
    let other = Calibration {
        driver: "another".into(),
        ..wins.clone()
    };
    for (calibration, want) in [(wins, true), (loses, false), (other, false)] {
        let certifier = |kernel: Method| {
            let options = SessionOptions {
                kernel,
                ..SessionOptions::default()
            };
            Certifier::with_gpu(&options, GpuUse::automatic(calibration.clone()))
        };
        for text in [
            "chainmail:rows=12,columns=12",
            "torus_link:segments=8000,toroidal=40,poloidal=40",
        ] {
            let built = text.parse::<Model>().unwrap().build().unwrap();
            for method in [Method::Auto, Method::Crossings] {
                let mut certifier = certifier(method);
                assert_eq!(*certifier.certify(&built.curves).0, built.certificate);
                assert_eq!(certifier.offload().tests > 0, want, "{text}");
                assert_eq!(certifier.device().is_some(), want);
            }
            for method in [Method::Direct, Method::BarnesHut] {
                let mut certifier = certifier(method);
                assert_eq!(*certifier.certify(&built.curves).0, built.certificate);
            }
        }
    }
}

/// The first blocks of an early exit have too few pairs for an adapter, later ones enough. A frame
/// that is not computed in full does not use the adapter.
#[test]
#[ignore = "needs an adapter"]
fn under_auto_the_adapter_counts_large_blocks_of_an_early_exit_and_no_quiet_frames() {
    // On more threads the CPU is predicted to be faster.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build();
    pool.unwrap().install(early_exit_and_quiet_frames);
}

fn early_exit_and_quiet_frames() {
    let built = "chainmail:rows=24,columns=24".parse::<Model>().unwrap();
    let built = built.build().unwrap();
    let verifier = |strategy, early_exit| {
        let options = SessionOptions {
            baseline: Some(built.certificate.clone()),
            strategy,
            early_exit,
            ..SessionOptions::default()
        };
        Engine::with_gpu(options, GpuUse::automatic(made_up(0.05, 1e6)))
    };
    let mut early = verifier(Strategy::Full, true);
    let report = early.step(0, 0.0, &built.curves).unwrap();
    assert_eq!(report.verdict, crate::Verdict::Intact);
    assert!(early.offload().tests > 0);
    let mut watch = verifier(Strategy::Incremental, false);
    for (seq, full) in [(0, true), (1, false)] {
        let report = watch.step(seq, 0.0, &built.curves).unwrap();
        assert_eq!(report.verdict, crate::Verdict::Intact);
        assert_eq!(watch.offload().tests > 0, full, "{:?}", watch.work());
        watch.settle();
    }
}
