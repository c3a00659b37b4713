//! Frames followed, against frames computed in full.

use super::*;
use crate::curve::Positions;
use crate::verdict::AbortOn;
use crate::verifier::Verifier;
use std::time::Instant;

/// Control points of a set, curve after curve.
fn points(set: &CurveSet) -> Vec<f32> {
    let mut bytes = Vec::new();
    set.write_positions(&mut bytes);
    bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }
}

#[test]
#[ignore = "a measurement: cargo test --release --lib incremental::tests::speed -- --ignored --nocapture"]
fn speed() {
    for (scene, diameter) in [
        ("knit", 1.0f32),
        ("chainmail", 0.1),
        ("glove", 0.1),
        ("knittubebroken", 0.02),
    ] {
        let Some(mut set) = scene_or_model(scene) else {
            continue;
        };
        let base = points(&set);
        let frames = std::env::var("FRAMES").map_or(40, |f| f.parse().unwrap());
        for amplitude in [0.0, 1e-2, 0.1, 0.2] {
            let mut verifier = Verifier::new(AbortOn::Never);
            verifier.set_incremental(true);
            let mut full = Verifier::new(AbortOn::Never);
            let mut random = noise(7);
            let (mut t_inc, mut t_full, mut t_read) = (vec![], vec![], vec![]);
            let mut works = vec![];
            for frame in 0..frames {
                let xyz: Vec<f32> = base
                    .iter()
                    .map(|x| x + random() * amplitude * diameter)
                    .collect();
                let start = Instant::now();
                let sum = xyz.chunks_exact(16).fold([0f32; 16], |mut a, c| {
                    for k in 0..16 {
                        a[k] = a[k].max(c[k]);
                    }
                    a
                });
                std::hint::black_box(sum);
                t_read.push(start.elapsed());
                set.update(Positions::F32(&xyz)).unwrap();
                let start = Instant::now();
                let a = verifier.step(frame, 0.0, &set).unwrap();
                t_inc.push(start.elapsed());
                works.push(verifier.work());
                if frame < 3 {
                    verifier.settle();
                }
                let start = Instant::now();
                if frame % 8 != 0 {
                    continue;
                }
                let b = full.step(frame, 0.0, &set).unwrap();
                t_full.push(start.elapsed());
                assert_eq!(
                    (a.verdict, &a.changes, &a.defects),
                    (b.verdict, &b.changes, &b.defects),
                    "{scene} {amplitude} {frame}"
                );
            }
            let med = |v: &mut Vec<std::time::Duration>| {
                v.sort();
                v[v.len() / 2].as_secs_f64() * 1e3
            };
            let last = works[works.len() - 2];
            let (r, i, f) = (med(&mut t_read), med(&mut t_inc), med(&mut t_full));
            println!(
                "{scene:14} {amplitude:7}: read {r:.3} inc {i:.3} ({:.1}) full {f:.3}  {last:?}",
                i / r
            );
        }
    }
}

#[test]
#[ignore = "a measurement: cargo test --release --lib incremental::tests::reference_speed -- --ignored --nocapture"]
fn reference_speed() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.unwrap();
    for input in [
        "knit",
        "chainmail",
        "glove",
        "knittubeinit",
        "knittubebroken",
    ] {
        let Some(set) = scene_or_model(input) else {
            continue;
        };
        let certificate = Verifier::new(AbortOn::Never).certify(&set).0.clone();
        for all in [false, true] {
            let cover = Cover {
                own: all,
                open: all,
            };
            let mut times = Vec::new();
            let mut allowances = Vec::new();
            for _ in 0..7 {
                let (set, certificate) = (set.clone(), certificate.clone());
                let start = Instant::now();
                let build = || Reference::build(set, certificate, 0, 0, cover);
                allowances = pool.install(build).allowances;
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            times.sort_by(f64::total_cmp);
            allowances.retain(|a| a.is_finite());
            allowances.sort_by(f32::total_cmp);
            let at = |percent: usize| allowances[(allowances.len() - 1) * percent / 100];
            println!(
                "{input:15} {cover:?}: {:.1} ms; allowances {:.4} (1 %) {:.4} (10 %) {:.4} (50 %) {:.4} (90 %)",
                times[3],
                at(1),
                at(10),
                at(50),
                at(90)
            );
        }
    }
}

/// A scene, or one of the models where they are there.
fn scene_or_model(name: &str) -> Option<CurveSet> {
    if let Ok(scene) = name.parse::<crate::scenes::Scene>() {
        return Some(scene.build().unwrap().curves);
    }
    let path = format!("../shared/models/{name}.bcc");
    crate::model::read(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).ok()
}
