//! Comparison with a supercell.

use crate::scene::Scene;
use crate::support::session::Step;
use linkwatch::{
    Certificate, Certifier, Events, FrameInfo, Image, PullThrough, Session, SessionOptions,
    Strategy,
};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Curve `i`, and curve `j` translated by an image.
type Pair = (u32, u32, Image);

/// Linking numbers that are not 0; `None` for pairs without one.
type Numbers = BTreeMap<Pair, Option<i64>>;

/// Returns the pair of two curves of a supercell, if it is one of those that a periodic scene has.
fn pair_of(scene: &Scene, images: &[Image], a: u32, b: u32) -> Option<Pair> {
    let count = scene.curves.len() as u32;
    // The curves themselves come first.
    let (i, j, image) = (a, b % count, images[(b / count) as usize]);
    let home = Image::default();
    if a >= count {
        return None;
    }
    match image == home {
        true => Some((i, j, image)),
        false if i < j || i == j && image > home => Some((i, j, image)),
        false => None,
    }
}

fn of_supercell(scene: &Scene, certificate: &Certificate) -> Numbers {
    let images = scene.images();
    let links = certificate.links().iter();
    let links = links.map(|l| (l.i, Some(l.j), Some(l.lambda)));
    let undefined = certificate.undefined().iter().map(|d| (d.i, d.j, None));
    let all = links.chain(undefined);
    let named = all.filter_map(|(a, b, lambda)| Some((pair_of(scene, &images, a, b?)?, lambda)));
    named.collect()
}

fn of_periodic(certificate: &Certificate) -> Numbers {
    let home = Image::default();
    let mut numbers = Numbers::new();
    for l in certificate.links() {
        numbers.insert((l.i, l.j, home), Some(l.lambda));
    }
    for d in certificate.undefined() {
        if let Some(j) = d.j {
            numbers.insert((d.i, j, d.image), None);
        }
    }
    for l in certificate.images().into_iter().flatten() {
        numbers.insert((l.i, l.j, l.image), Some(l.lambda));
    }
    numbers
}

/// Compares the linking numbers of a scene with those of its supercell. Returns how many there are
/// with images.
fn compare(seed: u64) -> usize {
    let scene = Scene::random(seed);
    let mut certifier = Certifier::default();
    let supercell = scene.supercell().set();
    let (certificate, _) = certifier.certify(&supercell);
    let expected = of_supercell(&scene, certificate);
    let found = of_periodic(&scene.certificate());
    assert_eq!(found, expected, "seed {seed}");
    found.keys().filter(|k| k.2 != Image::default()).count()
}

#[test]
fn linking_numbers_are_those_of_a_supercell() {
    let found: usize = (0..800).map(compare).sum();
    assert!(found > 600, "{found} linking numbers with images");
}

#[test]
#[ignore = "ten thousand scenes: minutes"]
fn linking_numbers_of_ten_thousand_scenes_are_those_of_a_supercell() {
    let found: usize = (0..10_000).map(compare).sum();
    println!("10,000 scenes: {found} linking numbers with images, all equal");
}

/// Returns the pull-throughs of the last of some frames, and its changes of linking numbers.
fn step(scenes: &[Scene], options: SessionOptions) -> (Vec<PullThrough>, Numbers, bool) {
    let mut session = Session::new(options).unwrap();
    let mut last = None;
    for (k, scene) in scenes.iter().enumerate() {
        let set = Arc::new(scene.set());
        last = Some(
            session
                .step_at(FrameInfo::at(k as u64, k as f64), &set)
                .report,
        );
    }
    let report = last.unwrap();
    let changes = report.changes.iter();
    let changes = changes.map(|c| ((c.i, c.j, c.image), Some(c.found)));
    let unsure = !report.defects.is_empty() || !report.missing.is_empty();
    let events = report.events.iter().chain(&report.unresolved).copied();
    (events.collect(), changes.collect(), unsure)
}

/// Compares the pull-throughs of a step with those of the supercell. Returns how many there are
/// with images.
fn compare_step(seed: u64, strategy: Strategy, closed: bool) -> usize {
    let mut scene = Scene::random(seed);
    scene.closed = closed;
    scene.reach = 2;
    scene.curves.iter_mut().for_each(|c| c.truncate(5));
    let amplitude = [0.05, 0.4, 1.2][seed as usize % 3];
    let frames: Vec<Scene> = [0, 1, 2]
        .map(|k| scene.moved(4 * seed + k, amplitude * f64::from(k as u32)))
        .into();
    let options = scene.options(strategy, Events::Between);
    let (found, changes, unsure) = step(&frames, options.clone());
    let large: Vec<Scene> = frames.iter().map(Scene::supercell).collect();
    let mut plain = options;
    plain.cell = None;
    let (all, all_changes, all_unsure) = step(&large, plain);
    let images = scene.images();
    let mut expected: Vec<PullThrough> = Vec::new();
    for e in all {
        if let Some((i, j, image)) = pair_of(&scene, &images, e.i, e.j) {
            expected.push(PullThrough { i, j, image, ..e });
        }
    }
    let named = all_changes.into_iter();
    let named = named.filter_map(|((a, b, _), l)| Some((pair_of(&scene, &images, a, b)?, l)));
    let expected_changes: Numbers = named.collect();
    assert_eq!(changes, expected_changes, "seed {seed}");
    // Scenes with contacts have defects, which hide no passages of other pairs.
    if !unsure && !all_unsure {
        let key = |e: &PullThrough| (e.i, e.j, e.image, e.segments, e.sign);
        let sorted = |mut events: Vec<PullThrough>| {
            events.sort_by_key(key);
            events.iter().map(key).collect::<Vec<_>>()
        };
        let count = found.iter().filter(|e| e.image != [0; 3]).count();
        assert_eq!(sorted(found), sorted(expected), "seed {seed}");
        return count;
    }
    0
}

#[test]
fn pull_throughs_are_those_of_a_supercell() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let found: usize = (0..60).map(|seed| compare_step(seed, strategy, true)).sum();
        assert!(
            found > 50,
            "{found} pull-throughs of closed curves with images"
        );
        let found: usize = (0..60)
            .map(|seed| compare_step(seed, strategy, false))
            .sum();
        assert!(
            found > 50,
            "{found} pull-throughs of open curves with images"
        );
    }
}
