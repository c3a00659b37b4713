//! Files that Pixar's library wrote.

use super::*;

#[test]
fn linked_rings_of_every_basis_are_linked() {
    for (name, basis) in [
        ("linear.usda", Basis::Polyline),
        ("bezier.usdc", Basis::Bezier),
        ("bspline.usdc", Basis::BSpline),
        ("catmull-rom.usda", Basis::CatmullRom),
    ] {
        let (set, labels) = only(&sample(name));
        assert_eq!(set.basis(), basis);
        assert_eq!(set.precision(), Precision::F32);
        assert_eq!(set.counts().collect::<Vec<_>>(), [-12, -12]);
        assert_eq!(links(&set), "0 1 -1;", "{name}");
        assert_eq!(labels.names, ["/rings[0]", "/rings[1]"]);
        assert_eq!(labels.radii, [0.125, 0.25]);
    }
}

#[test]
fn a_chain_in_compressed_arrays_has_its_links() {
    let (set, labels) = only(&sample("many.usdc"));
    assert_eq!(set.len(), 24);
    let lambda = |k: usize| if k.is_multiple_of(2) { "-1" } else { "+1" };
    let expected: String = (0..23)
        .map(|k| format!("{k} {} {};", k + 1, lambda(k)))
        .collect();
    assert_eq!(links(&set), expected);
    let radius = |k: usize| if k.is_multiple_of(3) { 0.125 } else { 0.0625 };
    assert_eq!(labels.radii, (0..24).map(radius).collect::<Vec<f32>>());
}

#[test]
fn samples_of_several_prims_are_frames_in_all_forms() {
    for name in ["apart.usda", "apart.usdc", "apart.usdz"] {
        let frames = frames(&sample(name));
        let seqs: Vec<u64> = frames.iter().map(|frame| frame.seq).collect();
        assert_eq!(seqs, [10, 12, 14, 15, 16], "{name}");
        for frame in &frames {
            assert_eq!(frame.time, frame.seq as f64 / 30.0);
            assert_eq!(frame.labels.names, ["/yarn/a", "/yarn/b"]);
            assert_eq!(frame.labels.radii, [0.125, 0.25]);
        }
        let sets: Vec<&CurveSet> = frames.iter().map(|f| f.curves.as_ref().unwrap()).collect();
        let found: Vec<String> = sets.iter().map(|set| links(set)).collect();
        assert_eq!(found, ["0 1 -1;", "0 1 -1;", "", "", ""]);
        // Between its samples at 14 and 16, the first ring is moved by 2.25, and the second one by
        // 0.1 per time code up to 15.
        assert_eq!(sets[3].point(0, 0), [1.0 - 2.25, 0.0, 0.0]);
        assert_eq!(sets[3].point(1, 0), [2.0, 0.0, 0.5]);
        assert_close(&[sets[1].point(1, 0)], &[[2.0, 0.0, 0.2]], 1e-15);
        assert_eq!(sets[4].point(1, 0), [2.0, 0.0, 0.5]);
    }
}

#[test]
fn transforms_are_those_of_pixars_library() {
    let [moved, flat] =
        ["transforms.usda", "transforms-flat.usdc"].map(|name| frames(&sample(name)));
    assert_eq!(moved.len(), 4);
    for (moved, flat) in moved.iter().zip(&flat) {
        assert_eq!((moved.seq, moved.time), (flat.seq, flat.time));
        let paths = [
            "/top/a",
            "/top/b[0]",
            "/top/b[1]",
            "/top/b/world",
            "/top/turn_XZY",
        ];
        assert_eq!(moved.labels.names[..5], paths);
        let [moved, flat] = [moved, flat].map(|frame| frame.curves.as_ref().unwrap());
        assert_eq!(moved.precision(), Precision::F64);
        let [moved, flat] = [moved, flat].map(curves);
        assert_eq!(moved.len(), 8);
        for (found, expected) in moved.iter().zip(&flat) {
            // The file has its rotations and expected points in single precision.
            assert_close(&found.1, &expected.1, 2e-6);
        }
    }
}

#[test]
fn pinned_splines_begin_and_end_at_their_points() {
    for (name, basis) in [
        ("pinned-bspline.usda", Basis::BSpline),
        ("pinned-catmull-rom.usdc", Basis::CatmullRom),
    ] {
        let (set, labels) = only(&sample(name));
        assert_eq!(set.basis(), basis);
        assert_eq!(set.counts().collect::<Vec<_>>(), [6, 4, 7]);
        let angle = |k: usize| k as f64 * std::f64::consts::FRAC_PI_6;
        for (i, (first, last)) in [(0, 3), (4, 5), (6, 10)].into_iter().enumerate() {
            let ends = [0, set.curve(i).segments as usize].map(|s| set.knot(i, s));
            let expected = [first, last].map(|k| [angle(k).cos(), angle(k).sin(), 0.0]);
            assert_close(&ends, &expected, 1e-7);
        }
        assert_eq!(labels.radii, [0.2, 0.25, 0.35]);
    }
    // Bezier curves reach their ends anyway.
    let (set, _) = only(&sample("open.usdc"));
    assert_eq!(set.precision(), Precision::F32);
    assert_eq!(set.counts().collect::<Vec<_>>(), [7, 4, 4]);
}
