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
        let mut set = match scene.parse::<crate::scenes::Scene>() {
            Ok(scene) => scene.build().unwrap().curves,
            Err(_) => {
                let path = std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR"))
                    .join(format!("../shared/models/{scene}.bcc"));
                match crate::model::read(&path) {
                    Ok(s) => s,
                    Err(_) => continue,
                }
            }
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
    for input in [
        "knit",
        "chainmail",
        "glove",
        "knittubeinit",
        "knittubebroken",
    ] {
        let set = match input.parse::<crate::scenes::Scene>() {
            Ok(scene) => scene.build().unwrap().curves,
            Err(_) => {
                let path = format!("/work/shared/models/{input}.bcc");
                crate::model::read(std::path::Path::new(&path)).unwrap()
            }
        };
        let certificate = Verifier::new(AbortOn::Never).certify(&set).0.clone();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .unwrap();
        for cover in [(false, false), (true, true)] {
            let cover = Cover {
                own: cover.0,
                open: cover.1,
            };
            let mut times = vec![];
            let mut reference = None;
            for _ in 0..5 {
                let (set, certificate) = (set.clone(), certificate.clone());
                let start = Instant::now();
                reference = Some(pool.install(|| Reference::build(set, certificate, 0, 0, cover)));
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            times.sort_by(f64::total_cmp);
            let reference = reference.unwrap();
            let mut a: Vec<f32> = reference
                .allowances
                .iter()
                .copied()
                .filter(|a| a.is_finite())
                .collect();
            a.sort_by(f32::total_cmp);
            let zero = a.iter().filter(|a| **a == 0.0).count();
            let at = |q: usize| a[(a.len() - 1) * q / 100];
            println!(
                "{input:15} {} segments {cover:?}: {:.1} ms, reach {:.4}, zero {zero} of {}, 1% {} 10% {} 50% {} 90% {}",
                set.segments(),
                times[2],
                reference.reach,
                a.len(),
                at(1),
                at(10),
                at(50),
                at(90)
            );
        }
    }
}
