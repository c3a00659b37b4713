//! Struts in periodic cells against those of a supercell, and known values.

use super::*;
use crate::curve::vector::{add, norm, per_axis, sub};
use crate::curve::{Basis, Positions};
use crate::periodic::{images_in, period, reduced};
use crate::random::Random;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

const HOME: Image = [0; 3];

fn set(counts: &[i32], points: &[Point]) -> CurveSet {
    CurveSet::from_counts(
        Basis::Polyline,
        counts,
        Positions::F64(points.as_flattened()),
    )
    .unwrap()
}

fn cell(text: &str) -> Cell {
    text.parse().unwrap()
}

/// A strut: curve and segment of both ends, and the image of the second one.
type Key = ([(u32, u32); 2], Image);

/// Returns the key of a strut between two images.
fn key([(a, m), (b, n)]: [((u32, u32), Image); 2]) -> Key {
    let image = per_axis(|x| n[x] - m[x]);
    let backward = image.map(|n| -n);
    let forward = match a.0 == b.0 {
        true => image > backward || image == HOME && a <= b,
        false => a.0 < b.0,
    };
    match forward {
        true => ([a, b], image),
        false => ([b, a], backward),
    }
}

/// Curves and their images, as curves of their own. Curves that run through the cell are continued.
struct Supercell {
    set: CurveSet,
    /// Curve, image of its first period, and number of segments of a period, of each curve.
    copies: Vec<(u32, Image, u32)>,
    periods: Vec<Image>,
}

impl Supercell {
    /// Returns all images up to these numbers of cells, and as many periods.
    fn new(scene: &CurveSet, cell: &Cell, most: [i32; 3]) -> Supercell {
        let periods: Vec<Image> = (0..scene.len())
            .map(|i| period(scene, i, cell).unwrap_or_default())
            .collect();
        let times = most.into_iter().max().unwrap() + 1;
        let (mut counts, mut points, mut copies) = (Vec::new(), Vec::new(), Vec::new());
        for (i, &period) in periods.iter().enumerate() {
            let curve = scene.curve(i);
            let images = images_in(most.map(|n| -n..=n));
            let images: BTreeSet<Image> = images.map(|image| reduced(image, period)).collect();
            let runs_through = period != HOME;
            let own: Vec<Point> = (0..curve.segments as usize)
                .map(|s| scene.knot(i, s))
                .collect();
            for image in images {
                let range = if runs_through { -times..=times } else { 0..=0 };
                let before = points.len();
                let first = per_axis(|x| image[x] + range.start() * period[x]);
                for m in range {
                    let by = per_axis(|x| image[x] + m * period[x]);
                    let by = cell.translation(by);
                    points.extend(own.iter().map(|&p| add(p, by)));
                }
                if !curve.closed && !runs_through {
                    let by = cell.translation(image);
                    points.push(add(scene.knot(i, own.len()), by));
                }
                let count = (points.len() - before) as i32;
                counts.push(if curve.closed { -count } else { count });
                copies.push((i as u32, first, own.len() as u32));
            }
        }
        Supercell {
            set: set(&counts, &points),
            copies,
            periods,
        }
    }

    /// Returns the struts that have an end on the given curves, and their lengths.
    fn struts(&self, longest: f64) -> BTreeMap<Key, f64> {
        let place = |end: &CurvePoint| {
            let (curve, first, segments) = self.copies[end.curve as usize];
            let period = self.periods[curve as usize];
            let times = (end.segment / segments) as i32;
            let image = per_axis(|x| first[x] + times * period[x]);
            ((curve, end.segment % segments), image)
        };
        let all = struts(&self.set, None, longest).unwrap();
        let at_home = all.iter().filter_map(|strut| {
            let ends = [place(&strut.ends[0]), place(&strut.ends[1])];
            let home = ends.iter().any(|end| end.1 == HOME);
            home.then(|| (key(ends), strut.length))
        });
        at_home.collect()
    }
}

/// Random curves in a random cell: closed ones, open ones, and some that run through the cell.
fn random_scene(random: &mut Random, lattice: bool) -> (CurveSet, Cell) {
    let cells = [
        "1,1,1",
        "2,0,0",
        "0,0,1.5",
        "1,0,2",
        "3,2,0",
        "2,0,0,0.9,2,0,0,0,3",
        "2,0,0,1,2,0,-1,1,2",
        "0,0,0,1,2,0,0,1,2",
        "1,0,0,0,3,0,0,0,3",
    ];
    let cell = cell(random.pick(&cells));
    let size = random.pick(&[0.3, 1.0, 2.5]);
    let (mut counts, mut points) = (Vec::new(), Vec::new());
    for _ in 0..1 + random.below(3_usize) {
        let n = 2 + random.below(14_usize);
        let center = random.point(2.0);
        let mut own: Vec<Point> = (0..n).map(|_| add(center, random.point(size))).collect();
        if lattice {
            own.iter_mut().flatten().for_each(|x| *x = x.round());
        }
        let period = per_axis(|x| match cell.periodic()[x] {
            true => random.below(3_i32) - 1,
            false => 0,
        });
        match random.below(3_usize) {
            0 if n > 2 => counts.push(-(n as i32)),
            1 if period != HOME => {
                own.push(add(own[0], cell.translation(period)));
                counts.push(n as i32 + 1);
            }
            _ => counts.push(n as i32),
        }
        points.extend(own);
    }
    (set(&counts, &points), cell)
}

/// Returns how many cells away images may be that are within a distance.
fn reach(scene: &CurveSet, cell: &Cell, distance: f64) -> [i32; 3] {
    let knots = (0..scene.len()).flat_map(|i| {
        let last = scene.curve(i).segments as usize;
        (0..=last).map(move |s| scene.knot(i, s))
    });
    let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in knots {
        lo = per_axis(|x| lo[x].min(p[x]));
        hi = per_axis(|x| hi[x].max(p[x]));
    }
    let inverse = cell.inverse().unwrap();
    per_axis(|x| match cell.periodic()[x] {
        true => (norm(inverse[x]) * (norm(sub(hi, lo)) + distance)).ceil() as i32,
        false => 0,
    })
}

#[test]
fn a_supercell_has_the_same_struts() {
    let (mut scenes, mut total, mut with_images) = (0, 0, 0);
    for seed in 0..120 {
        let mut random = Random::new(seed);
        let lattice = random.one_in(5);
        let (scene, cell) = random_scene(&mut random, lattice);
        let found = Thickness::of(&scene, Some(&cell)).unwrap();
        let context = format!("seed {seed}, cell {cell}");
        let shortest = found.poca.map_or(1.0, |strut| strut.length);
        let longest = (1.3 * shortest).max(0.2);
        let most = reach(&scene, &cell, longest);
        let images: i32 = most.iter().map(|n| 2 * n + 1).product();
        if images > 1000 {
            continue;
        }
        scenes += 1;
        let supercell = Supercell::new(&scene, &cell, most);
        let mut expected = supercell.struts(longest);
        let first = expected.values().copied().reduce(f64::min);
        match (first, found.poca) {
            (Some(first), Some(strut)) => {
                let error = (first - strut.length).abs();
                assert!(
                    error <= 1e-12 * first.max(1.0),
                    "{context}: {first} {strut}"
                );
            }
            (first, strut) => assert!(
                strut.is_none() && first.is_none(),
                "{context}: {first:?} {strut:?}"
            ),
        }
        let [of_all, bend] = [Thickness::of(&supercell.set, None).unwrap(), found]
            .map(|t| t.min_rad.map(|bend| bend.radius));
        let differ = of_all.unwrap_or(9.0) - bend.unwrap_or(9.0);
        assert!(differ.abs() <= 1e-9, "{context}: {of_all:?} {bend:?}");
        // Which of two struts between parallel edges is listed is a matter of rounding.
        if lattice {
            continue;
        }
        for strut in struts(&scene, Some(&cell), longest).unwrap() {
            let [a, b] = strut.ends.map(|end| (end.curve, end.segment));
            assert_eq!(key([(a, HOME), (b, strut.image)]), ([a, b], strut.image));
            let length = norm(sub(strut.ends[0].point, strut.ends[1].point));
            assert!((length - strut.length).abs() < 1e-12, "{context}: {strut}");
            let known = expected.remove(&([a, b], strut.image));
            let error = known.map_or(f64::INFINITY, |length| (length - strut.length).abs());
            let at_limit = strut.length > longest * (1.0 - 1e-9);
            assert!(at_limit || error <= 1e-12, "{context}: {known:?} {strut}");
            total += 1;
            with_images += usize::from(strut.image != HOME);
        }
        expected.retain(|_, length| *length < longest * (1.0 - 1e-9));
        assert!(expected.is_empty(), "{context}: {expected:?}");
    }
    let enough = scenes > 80 && total > 800 && with_images > 300;
    assert!(enough, "{scenes} scenes, {total} struts, {with_images}");
}

#[test]
fn the_octree_finds_what_all_pairs_find_in_a_cell() {
    let mut total = 0;
    for seed in 0..300 {
        let mut random = Random::new(seed);
        let lattice = random.one_in(3);
        let (scene, cell) = random_scene(&mut random, lattice);
        let edges = Edges::of(&scene, Some(&cell)).unwrap();
        let tree = Octree::new(&edges);
        let wanted = brute::shortest(&edges).unwrap();
        let found = tree.shortest(&edges).unwrap();
        let length = |found: &Option<Found>| found.map(|found| edges.strut(&found).length);
        assert_eq!(length(&found), length(&wanted), "seed {seed}");
        let longest = 1.5 * length(&wanted).unwrap_or(1.0).max(0.1);
        let [mut slow, mut fast] =
            [brute::up_to(&edges, longest), tree.up_to(&edges, longest)].map(Result::unwrap);
        slow.sort_by(Found::order);
        fast.sort_by(Found::order);
        assert_eq!(fast, slow, "seed {seed}");
        total += slow.len();
    }
    assert!(total > 3000, "{total}");
}

/// A straight yarn along an axis, and the images of a square lattice.
#[test]
fn straight_yarns_in_a_lattice_are_a_lattice_constant_apart() {
    for segments in [1, 3, 100] {
        let points: Vec<Point> = (0..=segments)
            .map(|k| [2.0 * f64::from(k) / f64::from(segments), 0.3, 7.1])
            .collect();
        let yarn = set(&[segments + 1], &points);
        for (text, expected) in [
            ("2,0.5,0.5", Some(0.5)),
            ("2,0.5,0", Some(0.5)),
            ("2,0,0,0.7,0.5,0,0,0,3", Some(0.5)),
            // The period is two lattice vectors: the image by one continues nothing.
            ("1,0.5,0.5", Some(0.0)),
            ("2,0,0", None),
        ] {
            let found = Thickness::of(&yarn, Some(&cell(text))).unwrap();
            assert_eq!(found.min_rad, None, "{text}");
            let length = found.poca.map(|strut| strut.length);
            let error = (length.unwrap_or(9.0) - expected.unwrap_or(9.0)).abs();
            assert!(error < 1e-12, "{text}, {segments} segments: {found:?}");
        }
    }
}

#[test]
fn a_ring_larger_than_the_cell_has_its_own_images_as_neighbours() {
    let ring: Vec<Point> = (0..200)
        .map(|k| {
            let (y, x) = (TAU * (f64::from(k) + 0.5) / 200.0).sin_cos();
            [5.0 * x, 5.0 * y, 0.0]
        })
        .collect();
    let ring = set(&[-200], &ring);
    for (text, expected) in [
        // Stacked, and beside one another with a gap of 2.5.
        ("0,0,0.125", 0.125),
        ("12.5,12.5,0.125", 0.125),
        ("0,12.5,4", 2.5),
        ("30,30,30", 10.0),
    ] {
        let found = Thickness::of(&ring, Some(&cell(text))).unwrap();
        let strut = found.poca.unwrap();
        let error = (strut.length / expected - 1.0).abs();
        assert!(error < 1e-3, "{text}: {strut}");
    }
    let found = Thickness::of(&ring, Some(&cell("30,30,4"))).unwrap();
    let strut = found.poca.unwrap();
    assert_eq!(strut.image, [0, 0, 1]);
    assert_eq!(
        strut.to_string().split(" are").next(),
        Some("curve 0 and its image 0,0,1")
    );
}

/// A yarn that bends only where its periods join.
#[test]
fn the_joint_of_two_periods_bends_and_is_no_strut() {
    let xyz: [Point; 3] = [[0.0; 3], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0]];
    for (points, vertex) in [(&xyz[..], 1), (&[xyz[0], [2.0, 0.0, 0.0]][..], 0)] {
        let yarn = set(&[points.len() as i32], points);
        let found = Thickness::of(&yarn, Some(&cell("2,0,0"))).unwrap();
        let bends = found.min_rad.map(|bend| (bend.radius, bend.vertex));
        match vertex {
            0 => assert_eq!(bends, None),
            _ => assert!((bends.unwrap().0 - 0.5 * 2_f64.sqrt()).abs() < 1e-12),
        }
        assert_eq!(found.poca, None);
    }
    // The joint is the sharpest bend.
    let points = [[0.0; 3], [1.0, 1.0, 0.0], [3.0, 1.0, 0.0], [4.0, 0.0, 0.0]];
    let yarn = set(&[4], &points);
    let bend = Thickness::of(&yarn, Some(&cell("4,0,0"))).unwrap();
    assert_eq!(bend.min_rad.unwrap().vertex, 0);
}

#[test]
fn moving_a_curve_by_a_lattice_vector_changes_only_the_image() {
    for seed in 0..100 {
        let mut random = Random::new(seed);
        let (scene, cell) = random_scene(&mut random, false);
        let shifts: Vec<Image> = (0..scene.len())
            .map(|_| {
                let far = random.pick(&[2, 1000]);
                let shift = [0; 3].map(|_| random.below(2 * far + 1) - far);
                per_axis(|x| if cell.periodic()[x] { shift[x] } else { 0 })
            })
            .collect();
        let (mut counts, mut points) = (Vec::new(), Vec::new());
        for (i, &shift) in shifts.iter().enumerate() {
            let curve = scene.curve(i);
            let count = curve.segments as usize + usize::from(!curve.closed);
            let by = cell.translation(shift);
            points.extend((0..count).map(|s| add(scene.knot(i, s), by)));
            let count = count as i32;
            counts.push(if curve.closed { -count } else { count });
        }
        let moved = set(&counts, &points);
        let [before, after] = [&scene, &moved].map(|set| {
            let found = struts(set, Some(&cell), 0.5).unwrap();
            found.into_iter().filter(|strut| strut.length < 0.499)
        });
        let place = |strut: &Strut| strut.ends.map(|end| (end.curve, end.segment));
        let before: BTreeMap<Key, f64> = before
            .map(|strut| ((place(&strut), strut.image), strut.length))
            .collect();
        let mut count = 0;
        for strut in after {
            let [a, b] = strut.ends.map(|end| shifts[end.curve as usize]);
            let image = per_axis(|x| strut.image[x] + b[x] - a[x]);
            let length = before.get(&(place(&strut), image));
            let error = length.map_or(f64::INFINITY, |l| (l - strut.length).abs());
            assert!(error < 1e-9, "seed {seed}: {strut} {length:?}");
            count += 1;
        }
        assert_eq!(count, before.len(), "seed {seed}");
    }
}

#[test]
fn cells_of_other_units_are_refused() {
    let ring = set(&[-3], &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    for text in ["1e-9,1e-9,1e-9", "1e-15,0,0"] {
        let e = struts(&ring, Some(&cell(text)), 1.0).unwrap_err();
        assert!(e.to_string().contains("too many periodic cells"), "{e}");
    }
    let flat = Cell {
        origin: [0.0; 3],
        vectors: [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0; 3]],
    };
    assert!(Thickness::of(&ring, Some(&flat)).is_err());
    assert!(struts(&ring, Some(&cell("1,1,1")), f64::INFINITY).is_err());
}

#[test]
fn images_of_splines_are_as_close_as_those_of_a_supercell() {
    let mut with_images = 0;
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let basis = random.pick(&[Basis::CatmullRom, Basis::BSpline]);
        let cell = cell(random.pick(&["2,0,0", "2,2,0", "2,0,0,1,2,0,-1,1,2"]));
        let n = 4 + random.below(6_usize);
        let points: Vec<Point> = (0..2 * n).map(|_| random.point(1.5)).collect();
        let counts = [-(n as i32); 2];
        let spline = |counts: &[i32], points: &[Point]| {
            CurveSet::from_counts(basis, counts, Positions::F64(points.as_flattened())).unwrap()
        };
        let scene = spline(&counts, &points);
        let found = Thickness::of(&scene, Some(&cell)).unwrap();
        let strut = found.poca.unwrap();
        let most = reach(&scene, &cell, strut.length).map(|n| n.min(4));
        let images = images_in(most.map(|n| -n..=n)).map(|image| cell.translation(image));
        let all: Vec<Point> = images
            .flat_map(|by| points.iter().map(move |&p| add(p, by)))
            .collect();
        let all = spline(&counts.repeat(all.len() / points.len()), &all);
        let expected = Thickness::of(&all, None).unwrap().poca.unwrap();
        let error = (expected.length - strut.length).abs();
        let context = format!("seed {seed}: {strut}, expected {expected}");
        assert!(error <= strut.error + expected.error + 1e-12, "{context}");
        let length = norm(sub(strut.ends[0].point, strut.ends[1].point));
        assert!((length - strut.length).abs() < 1e-12, "{context}");
        with_images += usize::from(strut.image != HOME);
    }
    assert!(with_images > 10, "{with_images}");
}

/// A wavy yarn as a spline, whose images along z are parallel to it.
#[test]
fn a_spline_that_runs_through_the_cell_goes_on_in_its_next_period() {
    let points: Vec<Point> = (0..20)
        .map(|k| {
            let k = f64::from(k);
            [0.4 * k, (TAU * k / 20.0).sin(), 0.0]
        })
        .collect();
    let closed = CurveSet::from_counts(
        Basis::CatmullRom,
        &[-20],
        Positions::F64(points.as_flattened()),
    )
    .unwrap();
    let cell = cell("8,0,0.5");
    let yarn = crate::Unwrap::default().unwrap(&closed, &cell).unwrap();
    assert!(period(&yarn, 0, &cell).is_some());
    let found = Thickness::of(&yarn, Some(&cell)).unwrap();
    let strut = found.poca.unwrap();
    assert!((strut.length - 0.5).abs() < 1e-12, "{strut}");
    // A sine of this amplitude and wavelength bends to (8 / 2 pi)^2.
    let bend = found.min_rad.unwrap();
    assert!((bend.radius / (8.0 / TAU).powi(2) - 1.0).abs() < 0.05);
    // A spline that begins in another direction than it ends in has a corner.
    let xyz = [[0.0; 3], [1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [8.0, 0.0, 0.0]];
    let bezier = CurveSet::from_counts(Basis::Bezier, &[4], Positions::F64(xyz.as_flattened()));
    let bend = Thickness::of(&bezier.unwrap(), Some(&cell)).unwrap();
    let bend = bend.min_rad.unwrap();
    assert_eq!((bend.radius, bend.vertex), (0.0, 0));
}
