//! The functions as a C program calls them: results, and bad input.

use crate::*;
use std::ffi::{CStr, CString, c_char, c_void};
use std::ptr::{null, null_mut};

/// Returns the description of the last error.
fn last_error() -> String {
    // SAFETY: the string is valid until the next call.
    let words = unsafe { CStr::from_ptr(lw_last_error()) };
    words.to_str().unwrap().to_owned()
}

/// Two rings of radius 1 in orthogonal planes, whose centres are `distance` apart.
fn rings(distance: f64) -> Vec<f64> {
    let mut out = Vec::new();
    for ring in 0..2 {
        for p in 0..16 {
            let angle = std::f64::consts::TAU * (f64::from(p) + 0.5 * f64::from(ring)) / 16.0;
            let (y, x) = angle.sin_cos();
            let x = x + f64::from(ring) * distance;
            out.extend(if ring == 0 { [x, y, 0.0] } else { [x, 0.0, y] });
        }
    }
    out
}

const COUNTS: [i32; 2] = [-16, -16];

fn frame(positions: &[f64]) -> lw_frame {
    lw_frame {
        basis: LW_POLYLINE,
        precision: LW_DOUBLE,
        curves: 2,
        counts: COUNTS.as_ptr(),
        positions: positions.as_ptr().cast::<c_void>(),
    }
}

fn empty_verdict() -> lw_verdict {
    // SAFETY: all members are numbers and booleans, for which zeros are valid.
    unsafe { std::mem::zeroed() }
}

fn text(verdict: &lw_verdict) -> &str {
    // SAFETY: the text ends with a zero byte.
    unsafe { CStr::from_ptr(verdict.text.as_ptr()) }
        .to_str()
        .unwrap()
}

#[test]
fn a_certificate_lists_the_links() {
    let positions = rings(1.0);
    // SAFETY: all pointers are valid.
    unsafe {
        let certificate = lw_certify(&frame(&positions), null());
        let mut count = 0;
        let links = lw_certificate_links(certificate, &mut count);
        assert_eq!((count, lw_certificate_undefined(certificate)), (1, 0));
        assert_eq!(((*links).i, (*links).j, (*links).lambda.abs()), (0, 1, 1));
        lw_certificate_free(certificate);

        let apart = rings(3.0);
        let certificate = lw_certify(&frame(&apart), null());
        assert!(lw_certificate_links(certificate, &mut count).is_null());
        assert_eq!(count, 0);
        lw_certificate_free(certificate);
    }
}

#[test]
fn a_ribbon_of_strands_in_opposite_directions_is_paired_by_base() {
    // A circle of DNA of 105 base pairs and 10 turns. The second strand is stored backwards.
    let n = 105;
    let vertex = |strand: usize, k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / n as f64;
        let (z, out) = (10.0 * angle + std::f64::consts::PI * strand as f64).sin_cos();
        let radius = 5.7 + out;
        [radius * angle.cos(), radius * angle.sin(), z]
    };
    let strands = (0..n).map(|k| vertex(0, k));
    let strands = strands.chain((0..n).rev().map(|k| vertex(1, k)));
    let positions: Vec<f64> = strands.flatten().collect();
    let frame = lw_frame {
        counts: [-105, -105].as_ptr(),
        ..frame(&positions)
    };
    // SAFETY: all members are numbers and booleans, for which zeros are valid.
    let mut found: lw_ribbon_values = unsafe { std::mem::zeroed() };
    // SAFETY: all pointers are valid.
    let mut ribbon = |second, pairing: *const c_char, tolerance| unsafe {
        let status = lw_ribbon(&frame, 0, second, pairing, false, tolerance, &mut found);
        (status, found)
    };
    for pairing in [null(), c"auto".as_ptr(), c"antiparallel".as_ptr()] {
        let (status, found) = ribbon(1, pairing, 0.0);
        assert_eq!((status, found.linking.abs()), (LW_OK, 10));
        assert!((found.twist.abs() - 10.0).abs() < 1e-6, "{found:?}");
        assert_eq!(
            (found.antiparallel, found.shift, found.rivals),
            (true, 0, 0)
        );
    }
    let (status, shifted) = ribbon(1, c"antiparallel:1".as_ptr(), 0.0);
    assert_eq!((status, shifted.shift), (LW_OK, 1));
    assert!((shifted.twist.abs() - 10.0).abs() > 0.5, "{shifted:?}");
    for (second, pairing, tolerance, words) in [
        (2, null(), 0.0, "two different curves of 0 to 1"),
        (
            1,
            c"near".as_ptr(),
            0.0,
            "expected auto, parallel, antiparallel",
        ),
        (1, null(), -1.0, "a tolerance of -1"),
    ] {
        assert_eq!(ribbon(second, pairing, tolerance).0, LW_ERROR);
        assert!(last_error().contains(words), "{}", last_error());
    }
}

#[test]
fn a_pull_through_is_reported_with_the_state_to_roll_back_to() {
    let mut verdict = empty_verdict();
    // SAFETY: all pointers are valid.
    unsafe {
        let session = lw_session_new(null());
        for (k, distance) in [1.0, 1.5, 2.5].into_iter().enumerate() {
            let positions = rings(distance);
            let status = lw_session_step(session, &frame(&positions), 0.5, &mut verdict);
            assert_eq!((status, verdict.seq), (LW_OK, k as u64));
        }
        assert_eq!((verdict.verdict, verdict.abort), (LW_CHANGED, true));
        assert_eq!((verdict.lost, verdict.pull_throughs), (1, 1));
        assert_eq!(
            (verdict.last_intact, verdict.finding),
            (1, LW_FINDING_CHANGE)
        );
        assert_eq!((verdict.i, verdict.j), (0, 1));
        let fraction = lw_safe_fraction(&frame(&rings(1.5)), &frame(&rings(2.5)));
        assert_eq!(verdict.safe_fraction, fraction);
        assert!(fraction > 0.4 && fraction < 0.5, "{fraction}");
        assert!(text(&verdict).contains("came apart"), "{}", text(&verdict));
        lw_session_free(session);
    }
}

#[test]
fn a_frame_with_nan_is_rejected_and_the_next_one_is_verified() {
    let (good, mut bad) = (rings(1.0), rings(1.0));
    bad[7] = f64::NAN;
    let mut verdict = empty_verdict();
    // SAFETY: all pointers are valid.
    unsafe {
        let session = lw_session_new(null());
        for (positions, want) in [(&good, LW_INTACT), (&bad, LW_REJECTED), (&good, LW_INTACT)] {
            let status = lw_session_step(session, &frame(positions), 0.0, &mut verdict);
            assert_eq!(
                (status, verdict.verdict),
                (LW_OK, want),
                "{}",
                text(&verdict)
            );
        }
        lw_session_free(session);
        assert!(lw_certify(&frame(&bad), null()).is_null());
        assert!(last_error().contains("NaN"), "{}", last_error());
        assert_eq!(lw_safe_fraction(&frame(&good), &frame(&bad)), -1.0);
    }
}

#[test]
fn bad_arguments_are_errors_with_words() {
    let positions = rings(1.0);
    let good = frame(&positions);
    let cases: [(lw_frame, &str); 5] = [
        (lw_frame { basis: 4, ..good }, "basis 4"),
        (
            lw_frame {
                precision: 3,
                ..good
            },
            "precision 3",
        ),
        (
            lw_frame {
                counts: null(),
                ..good
            },
            "counts is null",
        ),
        (
            lw_frame {
                positions: null(),
                ..good
            },
            "positions is null",
        ),
        (
            lw_frame {
                positions: positions.as_ptr().cast::<u8>().wrapping_add(1).cast(),
                ..good
            },
            "not aligned",
        ),
    ];
    // SAFETY: all pointers are valid or null; the others are refused before they are read.
    unsafe {
        for (frame, words) in &cases {
            assert!(lw_certify(frame, null()).is_null());
            assert!(last_error().contains(words), "{}", last_error());
        }
        assert!(lw_certify(null(), null()).is_null());
        assert_eq!(last_error(), "frame is null");
        let status = lw_session_step(null_mut(), &good, 0.0, null_mut());
        assert_eq!(
            (status, last_error().as_str()),
            (LW_ERROR, "session is null")
        );
        let word = CString::new("sometimes").unwrap();
        let options = lw_session_options {
            baseline: null_mut(),
            events: LW_EVENTS_ALL,
            abort_on: word.as_ptr(),
            motion_limit: 0.0,
            thickness: 0.0,
            radii: null(),
            curves: 0,
            min_clearance: 0.0,
            wrapped: 0,
            keep_open: 0,
        };
        assert!(lw_session_new(&options).is_null());
        assert!(
            last_error().starts_with("abort_on \"sometimes\""),
            "{}",
            last_error()
        );
        lw_session_free(null_mut());
        lw_certificate_free(null_mut());
        lw_close(null_mut());
    }
}

/// Opens a client on a service of this test.
fn open(test: &str) -> (*mut lw_client, CString) {
    let name = format!("linkwatch-c-{test}-{}", std::process::id());
    let name = CString::new(name).unwrap();
    // SAFETY: the string ends with a zero byte, and null options are the defaults.
    let client = unsafe { lw_open(name.as_ptr().cast::<c_char>(), null()) };
    assert!(!client.is_null(), "{}", last_error());
    (client, name)
}

#[test]
fn frames_are_published_without_a_watcher() {
    let (client, _) = open("alone");
    // SAFETY: the client is valid until lw_finish.
    unsafe {
        assert!(lw_begin_double(client, 0.0).is_null());
        assert!(
            last_error().contains("no curves are declared"),
            "{}",
            last_error()
        );
        let described = lw_describe(client, LW_POLYLINE, LW_DOUBLE, COUNTS.as_ptr(), 2);
        assert_eq!(described, LW_OK, "{}", last_error());
        assert_eq!(lw_publish(client, null_mut()), LW_ERROR);
        assert!(
            last_error().contains("no frame was begun"),
            "{}",
            last_error()
        );
        assert!(lw_begin_float(client, 0.0).is_null());
        assert!(
            last_error().contains("bytes of a coordinate"),
            "{}",
            last_error()
        );
        // Regression test: a frame was begun, and published without any positions.
        assert_eq!(lw_publish(client, null_mut()), LW_ERROR);
        for k in 0..100 {
            // The frame is begun twice, and the first memory is discarded.
            assert!(!lw_begin_double(client, f64::from(k)).is_null());
            let points = lw_begin_double(client, f64::from(k));
            assert!(
                !points.is_null() && points.addr().is_multiple_of(64),
                "{}",
                last_error()
            );
            let positions = rings(1.0);
            points.copy_from_nonoverlapping(positions.as_ptr(), positions.len());
            let mut seq = 77;
            assert_eq!((lw_publish(client, &mut seq), seq), (LW_OK, k as u64));
            assert_eq!(lw_poll(client, null_mut()), LW_NOTHING);
        }
        assert!(!lw_aborted(client, null_mut()));
        assert_eq!(lw_silent_for(client), -1.0);
        assert_eq!(lw_wait(client, 99, 0.01, null_mut()), LW_STALE);
        assert_eq!(lw_wait(client, 99, -1.0, null_mut()), LW_ERROR);
        assert!(
            last_error().starts_with("a wait of -1 seconds"),
            "{}",
            last_error()
        );
        assert_eq!(lw_wait_for_watcher(client, 0.01), LW_NOTHING);
        assert_eq!((lw_cut(client), lw_resume(client)), (LW_OK, LW_OK));
        let described = lw_describe(client, LW_POLYLINE, LW_DOUBLE, COUNTS.as_ptr(), 2);
        assert_eq!(described, LW_ERROR);
        assert!(
            last_error().contains("after the first frame"),
            "{}",
            last_error()
        );
        assert_eq!(lw_finish(client, 0.01, null_mut()), LW_NOTHING);
    }
}

#[test]
fn named_curves_are_described_again() {
    let (client, _) = open("named");
    let names = |names: [&'static CStr; 2]| names.map(CStr::as_ptr);
    let radii = [0.5_f32, 0.25];
    let describe = |names: *const *const c_char, radii: *const f32| {
        // SAFETY: the client is valid until lw_finish, and so are the arrays during the call.
        unsafe {
            let (kind, counts) = ((LW_POLYLINE, LW_DOUBLE), COUNTS.as_ptr());
            lw_describe_labelled(client, kind.0, kind.1, counts, 2, names, radii)
        }
    };
    let publish = || {
        let positions = rings(1.0);
        // SAFETY: the client is valid until lw_finish.
        unsafe {
            let points = lw_begin_double(client, 0.0);
            assert!(!points.is_null(), "{}", last_error());
            points.copy_from_nonoverlapping(positions.as_ptr(), positions.len());
            assert_eq!(lw_publish(client, null_mut()), LW_OK, "{}", last_error());
        }
    };
    let same = names([c"a", c"a"]);
    assert_eq!(describe(same.as_ptr(), null()), LW_ERROR);
    assert!(
        last_error().contains("which is that of curve 0"),
        "{}",
        last_error()
    );
    assert_eq!(describe([c"a".as_ptr(), null()].as_ptr(), null()), LW_ERROR);
    assert!(
        last_error().contains("the name of a curve"),
        "{}",
        last_error()
    );
    assert_eq!(describe(null(), [0.5, -1.0].as_ptr()), LW_ERROR);
    assert!(last_error().contains("radius -1"), "{}", last_error());
    for pair in [names([c"a", c"b"]), names([c"b", c"new"])] {
        assert_eq!(
            describe(pair.as_ptr(), radii.as_ptr()),
            LW_OK,
            "{}",
            last_error()
        );
        publish();
    }
    assert_eq!(describe(null(), null()), LW_ERROR);
    assert!(last_error().contains("without names"), "{}", last_error());
    // SAFETY: as above.
    unsafe {
        assert_eq!(lw_set_time_step(client, -1.0), LW_ERROR);
        assert_eq!(lw_set_time_step(client, 1e-3), LW_OK);
        assert_eq!(lw_finish(client, 0.01, null_mut()), LW_NOTHING);
    }
}

#[test]
fn a_periodic_cell_that_is_no_lattice_is_refused() {
    let (client, _) = open("cell");
    let refused = |vectors: [f64; 9], corner: *const f64, words: &str| {
        // SAFETY: the client is valid until lw_finish, and so are the arrays during the call.
        unsafe { assert_eq!(lw_set_cell(client, vectors.as_ptr(), corner), LW_ERROR) };
        assert!(last_error().contains(words), "{}", last_error());
    };
    refused([0.0; 9], null(), "no vector");
    refused([1.0; 9], null(), "one plane");
    refused(CELL, [0.0, f64::NAN, 0.0].as_ptr(), "not finite");
    // SAFETY: as above.
    unsafe {
        let corner = [-5.0, -5.0, 0.0];
        assert_eq!(lw_set_cell(client, CELL.as_ptr(), corner.as_ptr()), LW_OK);
        assert_eq!(lw_set_cell(client, null(), null()), LW_OK);
        assert_eq!(lw_set_cell(null_mut(), CELL.as_ptr(), null()), LW_ERROR);
        assert_eq!(last_error(), "client is null");
        assert_eq!(lw_finish(client, 0.01, null_mut()), LW_NOTHING);
    }
}

/// Repeats along x and y.
const CELL: [f64; 9] = [10.0, 0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0];

#[test]
fn a_link_across_the_boundary_is_lost_with_its_image() {
    let mut verdict = empty_verdict();
    // SAFETY: all pointers are valid.
    unsafe {
        let session = lw_session_new(null());
        let flat = [1.0; 9];
        let set = lw_session_set_cell(session, flat.as_ptr(), null());
        assert_eq!(set, LW_ERROR);
        assert!(last_error().contains("one plane"), "{}", last_error());
        for (distance, edge) in [(9.0, 10.0), (9.5, 10.5), (8.0, 10.5)] {
            let mut cell = CELL;
            cell[0] = edge;
            let set = lw_session_set_cell(session, cell.as_ptr(), null());
            assert_eq!(set, LW_OK, "{}", last_error());
            let positions = rings(distance);
            let status = lw_session_step(session, &frame(&positions), 0.0, &mut verdict);
            assert_eq!(status, LW_OK, "{}", last_error());
            let want = if distance > 8.0 {
                LW_INTACT
            } else {
                LW_CHANGED
            };
            assert_eq!(verdict.verdict, want, "{}", text(&verdict));
        }
        assert_eq!((verdict.lost, verdict.pull_throughs), (1, 1));
        assert_eq!((verdict.i, verdict.j, verdict.image), (0, 1, [-1, 0, 0]));
        let along_x = [10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        for (vectors, why) in [
            (along_x.as_ptr(), "other vectors"),
            (null(), "no periodic cell"),
        ] {
            assert_eq!(lw_session_set_cell(session, vectors, null()), LW_OK);
            let status = lw_session_step(session, &frame(&rings(9.5)), 0.0, &mut verdict);
            assert_eq!((status, verdict.verdict), (LW_OK, LW_REJECTED));
            assert!(text(&verdict).contains(why), "{}", text(&verdict));
        }
        lw_session_free(session);
    }
}

/// A frame of these curves of 16 points.
fn curves(counts: &[i32], positions: &[f64]) -> lw_frame {
    lw_frame {
        curves: counts.len(),
        counts: counts.as_ptr(),
        ..frame(positions)
    }
}

/// A session, and the functions that tests call. It is freed when it is dropped.
struct InProcess(*mut lw_session);

impl InProcess {
    fn new(options: *const lw_session_options) -> InProcess {
        // SAFETY: the options are null or valid.
        let session = unsafe { lw_session_new(options) };
        assert!(!session.is_null(), "{}", last_error());
        InProcess(session)
    }

    fn describe(&self, names: &[&CStr], radii: &[f32]) -> lw_status {
        let pointers: Vec<_> = names.iter().map(|name| name.as_ptr()).collect();
        let curves = names.len().max(radii.len());
        let radii = match radii {
            [] => null(),
            radii => radii.as_ptr(),
        };
        // SAFETY: all pointers are valid or null.
        unsafe { lw_session_describe(self.0, pointers.as_ptr(), radii, curves) }
    }

    fn step(&self, frame: lw_frame) -> lw_verdict {
        let mut verdict = empty_verdict();
        // SAFETY: all pointers are valid.
        let status = unsafe { lw_session_step(self.0, &frame, 0.0, &mut verdict) };
        assert_eq!(status, LW_OK, "{}", last_error());
        verdict
    }
}

impl Drop for InProcess {
    fn drop(&mut self) {
        // SAFETY: the session is not used afterwards.
        unsafe { lw_session_free(self.0) }
    }
}

#[test]
fn curves_that_come_and_go_in_process_are_compared_by_name() {
    let linked = rings(1.0);
    let (left, right) = linked.split_at(48);
    let far: Vec<f64> = left.iter().map(|x| x + 20.0).collect();
    let three = [left, &far, right].concat();
    let session = InProcess::new(null());
    assert_eq!(session.describe(&[c"left", c"right"], &[]), LW_OK);
    assert_eq!(session.step(frame(&linked)).verdict, LW_INTACT);

    assert_eq!(session.describe(&[c"left", c"new", c"right"], &[]), LW_OK);
    let verdict = session.step(curves(&[-16; 3], &three));
    assert_eq!(
        (verdict.verdict, verdict.appeared, verdict.gone),
        (LW_INTACT, 1, 0)
    );
    assert!(
        text(&verdict).contains("curves appeared: new"),
        "{}",
        text(&verdict)
    );
    // The description is kept until it is replaced.
    let verdict = session.step(frame(&linked));
    assert_eq!(verdict.verdict, LW_REJECTED);
    assert!(
        text(&verdict).contains("number of curves was 3, is 2"),
        "{}",
        text(&verdict)
    );

    // A ring is pulled out, and the curve between is gone.
    assert_eq!(session.describe(&[c"right", c"left"], &[]), LW_OK);
    let pulled: Vec<f64> = left.iter().map(|x| x - 3.0).collect();
    let verdict = session.step(frame(&[right, &pulled].concat()));
    assert_eq!(
        (verdict.verdict, verdict.appeared, verdict.gone),
        (LW_CHANGED, 0, 1)
    );
    assert_eq!((verdict.lost, verdict.i, verdict.j), (1, 0, 1));
    let says = "curves 0 (right) and 1 (left) came apart";
    assert!(text(&verdict).contains(says), "{}", text(&verdict));
}

#[test]
fn a_session_is_cut_and_accepts_a_new_baseline() {
    let session = InProcess::new(null());
    let mut bad = rings(3.0);
    bad[0] = f64::NAN;
    let step = |distance| {
        let positions = rings(distance);
        let verdict = session.step(frame(&positions));
        (
            verdict.verdict,
            verdict.lost,
            verdict.gained,
            verdict.pull_throughs,
        )
    };
    assert_eq!(step(1.0), (LW_INTACT, 0, 0, 0));
    assert_eq!(step(3.0), (LW_CHANGED, 1, 0, 1));
    // SAFETY: the session is valid.
    unsafe {
        assert_eq!(lw_session_cut(session.0), LW_OK);
        assert_eq!(step(1.0), (LW_INTACT, 0, 0, 0));
        assert_eq!(lw_session_accept(session.0), LW_OK);
        assert_eq!(session.step(frame(&bad)).verdict, LW_REJECTED);
        assert_eq!(step(3.0), (LW_INTACT, 0, 0, 0));
        assert_eq!(step(3.1), (LW_INTACT, 0, 0, 0));
        assert_eq!(step(1.0), (LW_CHANGED, 0, 1, 1));
        assert_eq!(lw_session_accept(null_mut()), LW_ERROR);
        assert_eq!(last_error(), "session is null");
        assert_eq!(lw_session_cut(null_mut()), LW_ERROR);
        assert_eq!(lw_session_describe(null_mut(), null(), null(), 0), LW_ERROR);
    }
}

#[test]
fn radii_in_process_belong_to_the_curves_that_are_described() {
    // SAFETY: zeros are valid values of the structures.
    let mut options: lw_session_options = unsafe { std::mem::zeroed() };
    let radii = [0.2_f32, 0.2];
    (options.radii, options.curves) = (radii.as_ptr(), 2);
    let session = InProcess::new(&options);
    let ratio = || {
        let positions = rings(1.7);
        assert_eq!(session.step(frame(&positions)).verdict, LW_INTACT);
        // SAFETY: all pointers are valid, and zeros are valid values of the structure.
        unsafe {
            let mut clearance: lw_clearance = std::mem::zeroed();
            let status = lw_session_clearance(session.0, &mut clearance);
            assert_eq!(status, LW_OK, "{}", last_error());
            clearance.ratio
        }
    };
    let first = ratio();
    for (radii, why) in [
        (&[][..], "a positive radius of each curve"),
        (&[0.5, 0.0][..], "a positive radius of each curve"),
        (&[0.5, f32::INFINITY][..], "radius inf"),
    ] {
        assert_eq!(session.describe(&[c"a", c"b"], radii), LW_ERROR);
        assert!(last_error().contains(why), "{}", last_error());
    }
    assert_eq!(ratio(), first);
    let plain = InProcess::new(null());
    assert_eq!(plain.describe(&[c"a", c"b"], &[0.1, 0.1]), LW_ERROR);
    assert!(
        last_error().contains("radii have no effect"),
        "{}",
        last_error()
    );
    assert_eq!(plain.describe(&[c"a", c"a"], &[]), LW_ERROR);
    assert!(
        last_error().contains("which is that of curve 0"),
        "{}",
        last_error()
    );
}

#[test]
fn a_certificate_in_a_cell_lists_the_links_with_images() {
    let positions = rings(9.0);
    let mut count = 9;
    // SAFETY: all pointers are valid.
    unsafe {
        let certificate = lw_certify(&frame(&positions), CELL.as_ptr());
        assert!(!certificate.is_null(), "{}", last_error());
        assert!(lw_certificate_links(certificate, &mut count).is_null());
        assert_eq!(lw_certificate_undefined(certificate), 0);
        let images = lw_certificate_images(certificate, &mut count);
        assert_eq!((count, (*images).i, (*images).j), (1, 0, 1));
        assert_eq!((*images).image, [-1, 0, 0]);
        assert_eq!((*images).lambda.abs(), 1);
        lw_certificate_free(certificate);

        // Without a cell, there are none.
        let certificate = lw_certify(&frame(&positions), null());
        assert!(lw_certificate_images(certificate, &mut count).is_null());
        assert_eq!(count, 0);
        lw_certificate_free(certificate);

        // A ring beside the image of another ring is not linked with it.
        let apart = rings(7.5);
        let certificate = lw_certify(&frame(&apart), CELL.as_ptr());
        assert!(lw_certificate_images(certificate, &mut count).is_null());
        assert_eq!(count, 0);
        lw_certificate_free(certificate);

        let flat = [1.0; 9];
        assert!(lw_certify(&frame(&positions), flat.as_ptr()).is_null());
        assert!(last_error().contains("one plane"), "{}", last_error());
        let mut bad = rings(9.0);
        bad[7] = f64::NAN;
        assert!(lw_certify(&frame(&bad), CELL.as_ptr()).is_null());
        assert!(last_error().contains("NaN"), "{}", last_error());
    }
}

#[test]
fn struts_and_clearance_in_a_cell_name_the_image() {
    // The second ring is 0.5 away from the image of the first one.
    let positions = rings(7.5);
    let mut verdict = empty_verdict();
    // SAFETY: all pointers are valid, and zeros are valid values of the structures.
    unsafe {
        let (mut values, mut clearance) = std::mem::zeroed::<(lw_thickness_values, lw_clearance)>();
        let mut options: lw_session_options = std::mem::zeroed();
        options.thickness = 0.5;
        let found = lw_thickness(&frame(&positions), CELL.as_ptr(), 1.0, &mut values);
        assert_eq!(found, LW_OK, "{}", last_error());
        assert!(values.poca > 0.4 && values.poca < 0.6, "{values:?}");
        let struts = lw_struts_up_to(&frame(&positions), CELL.as_ptr(), 1.0);
        let mut count = 0;
        let shortest = *lw_struts_list(struts, &mut count);
        assert_eq!((shortest.curves, shortest.image), ([0, 1], [-1, 0, 0]));
        assert_eq!(shortest.length, values.poca);
        lw_struts_free(struts);
        let struts = lw_struts_up_to(&frame(&positions), null(), 1.0);
        assert!(lw_struts_list(struts, &mut count).is_null());
        assert_eq!(count, 0, "without a cell there are no images");
        lw_struts_free(struts);

        let session = lw_session_new(&options);
        let set = lw_session_set_cell(session, CELL.as_ptr(), null());
        assert_eq!(set, LW_OK, "{}", last_error());
        lw_session_step(session, &frame(&positions), 0.0, &mut verdict);
        assert_eq!(lw_session_clearance(session, &mut clearance), LW_OK);
        assert!((clearance.ratio - values.poca).abs() < 1e-9);
        assert_eq!((clearance.curves, clearance.image), ([0, 1], [-1, 0, 0]));
        lw_session_free(session);
    }
}

#[test]
fn a_second_simulator_on_one_name_is_refused() {
    let (client, name) = open("second");
    // SAFETY: the string ends with a zero byte, and the client is closed once.
    unsafe {
        assert!(lw_open(name.as_ptr(), null()).is_null());
        assert!(last_error().contains("another"), "{}", last_error());
        assert!(lw_open(null(), null()).is_null());
        assert_eq!(last_error(), "the name of the service is null");
        let spin = lw_options {
            lockstep: false,
            wait_mode: 2,
        };
        assert!(lw_open(name.as_ptr(), &spin).is_null());
        assert!(last_error().starts_with("wait mode 2"), "{}", last_error());
        lw_close(client);
        let again = lw_open(name.as_ptr(), null());
        assert!(!again.is_null(), "{}", last_error());
        lw_close(again);
    }
}

#[test]
fn struts_have_their_gradient_and_clearance_warns_before_a_pull_through() {
    let mut clearance = lw_clearance {
        at_least: 0.0,
        ratio: 0.0,
        error: 0.0,
        curves: [0; 2],
        segments: [0; 2],
        points: [[0.0; 3]; 2],
        low: false,
        frames_left: 0.0,
        image: [0; 3],
    };
    let mut verdict = empty_verdict();
    let radii = [0.1_f32; 2];
    let mut options = lw_session_options {
        baseline: null_mut(),
        events: LW_EVENTS_ALL,
        abort_on: c"clearance".as_ptr(),
        motion_limit: 0.0,
        thickness: 0.0,
        radii: radii.as_ptr(),
        curves: 2,
        min_clearance: 0.8,
        wrapped: 0,
        keep_open: 0,
    };
    // SAFETY: all pointers are valid.
    unsafe {
        let session = lw_session_new(&options);
        assert_eq!(lw_session_clearance(session, &mut clearance), LW_NOTHING);
        let mut warned = false;
        for k in 0..30 {
            let positions = rings(1.7 + 0.02 * f64::from(k));
            lw_session_step(session, &frame(&positions), 0.0, &mut verdict);
            if verdict.verdict == LW_CHANGED {
                break;
            }
            assert_eq!(verdict.verdict, LW_INTACT, "{}", text(&verdict));
            assert_eq!(lw_session_clearance(session, &mut clearance), LW_OK);
            // The gradient of a motion of the whole scene is 0.
            let struts = lw_struts_up_to(&frame(&positions), null(), 1.0);
            let mut count = 0;
            let shortest = *lw_struts_list(struts, &mut count);
            assert!(count > 0 && (shortest.length - 0.2 * clearance.ratio).abs() < 1e-7);
            let total: f64 = shortest.gradient.iter().flatten().map(|g| g[0]).sum();
            assert!(total.abs() < 1e-12, "{total}");
            lw_struts_free(struts);
            assert_eq!(verdict.abort, clearance.ratio < 0.8);
            warned |= clearance.low;
        }
        assert!(warned && verdict.verdict == LW_CHANGED);
        lw_session_free(session);

        options.curves = 1;
        let session = lw_session_new(&options);
        let positions = rings(1.0);
        lw_session_step(session, &frame(&positions), 0.0, &mut verdict);
        assert_eq!(verdict.verdict, LW_REJECTED);
        let why = "radii of curves: 2 promised, 1 available";
        assert!(text(&verdict).contains(why), "{}", text(&verdict));
        assert_eq!(lw_session_clearance(session, &mut clearance), LW_NOTHING);
        lw_session_free(session);
        (options.radii, options.thickness) = (null(), -1.0);
        assert!(lw_session_new(&options).is_null());
        assert!(last_error().contains("radius of -1"), "{}", last_error());

        let mut values = std::mem::zeroed();
        assert_eq!(
            lw_thickness(&frame(&positions), null(), 1.0, &mut values),
            LW_OK
        );
        assert!(values.min_rad > 0.9 && values.poca < 1.0 && values.thickness == values.poca);
        assert_eq!(
            lw_thickness(&frame(&positions), null(), 0.0, &mut values),
            LW_ERROR
        );
        assert!(lw_struts_up_to(null(), null(), 1.0).is_null());
    }
}

#[test]
fn rings_that_repeat_their_first_point_are_closed() {
    let counts = [5, 5];
    // Two linked squares.
    let positions: [f64; 30] = [
        -1., -1., 0., 1., -1., 0., 1., 1., 0., -1., 1., 0., -1., -1., 5e-15, //
        0., 0., -1., 2., 0., -1., 2., 0., 1., 0., 0., 1., 0., 0., -1.,
    ];
    let frame = lw_frame {
        basis: LW_POLYLINE,
        precision: LW_DOUBLE,
        curves: 2,
        counts: counts.as_ptr(),
        positions: positions.as_ptr().cast::<c_void>(),
    };
    let mut verdict = lw_verdict::NONE;
    // SAFETY: all pointers are valid.
    unsafe {
        let certificate = lw_certify(&frame, null());
        let mut links = 0;
        lw_certificate_links(certificate, &mut links);
        assert_eq!(links, 1);
        lw_certificate_free(certificate);
        let session = lw_session_new(null());
        assert_eq!(lw_session_step(session, &frame, 0.0, &mut verdict), LW_OK);
        let notes = CStr::from_ptr(lw_session_notes(session));
        let says = "2 curves end where they start and are closed";
        assert!(notes.to_str().unwrap().starts_with(says), "{notes:?}");
        assert!(lw_session_notes(session).is_null());
        lw_session_free(session);
    }
}
