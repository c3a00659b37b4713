//! Compares the certificates of real models with the expected ones. The models are large and not
//! part of the project. Without their files, these tests report that and pass.

use linkwatch::{Basis, Certificate, Verifier, homotopic_polylines, model};
use std::path::PathBuf;

/// Returns the path of a model beside the project, if it exists.
fn model_file(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/models")
        .join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {} is not here", path.display());
    None
}

fn certify(name: &str) -> Option<Certificate> {
    let set = model::read(&model_file(name)?).unwrap();
    let mut verifier = Verifier::default();
    let (certificate, stats) = verifier.certify(&set);
    println!("{name}: {stats:?}");
    assert_eq!(certificate.undefined, []);
    Some(certificate.clone())
}

#[test]
fn certificates_equal_the_expected_ones() {
    for (file, expected) in [
        ("glove.bcc", "glove.certificate.txt"),
        ("knittubeinit.bcc", "knittubeinit.certificate.txt"),
        ("knittubebroken.bcc", "knittubebroken.certificate.txt"),
        ("houdiniobj.obj", "houdiniobj.certificate.txt"),
    ] {
        if let (Some(found), Some(expected)) = (certify(file), model_file(expected)) {
            assert_eq!(found, Certificate::read(&expected).unwrap(), "{file}");
        }
    }
}

#[test]
fn rolfsen_links_have_their_linking_numbers() {
    for (file, expected) in [
        ("2.2.1.vect", "2 # lines: 1\n0,1,1\n"),
        ("4.2.1.vect", "2 # lines: 1\n0,1,-2\n"),
        ("5.2.1.vect", "2 # lines: 0\n"),
        ("6.3.2.vect", "3 # lines: 0\n"),
        ("3.1.vect", "1 # lines: 0\n"),
        ("4.1.vect", "1 # lines: 0\n"),
    ] {
        if let Some(found) = certify(file) {
            assert_eq!(found.to_string(), expected, "{file}");
        }
    }
}

/// Algorithm 3 as published: its counts equal those of verifycurves, and its polylines have the
/// same certificate as the lazy discretization of each pair.
#[test]
fn algorithm_3_gives_the_published_counts_and_the_same_certificates() {
    for (file, overlaps, segments) in [
        ("glove.bcc", Some(3867), Some(65_933)),
        ("knittubebroken.bcc", None, Some(27_530)),
        ("knittubeinit.bcc", None, None),
    ] {
        let Some(path) = model_file(file) else {
            continue;
        };
        let set = model::read(&path).unwrap();
        let polylines = homotopic_polylines(&set).unwrap();
        println!(
            "{file}: {} overlaps, {} segments, {} passes",
            polylines.overlaps,
            polylines.curves.segments(),
            polylines.passes
        );
        assert_eq!(polylines.curves.basis(), Basis::Polyline);
        assert!(polylines.too_close.is_empty());
        assert!(overlaps.is_none_or(|n| n == polylines.overlaps));
        assert!(segments.is_none_or(|n| n == polylines.curves.segments()));
        let mut verifier = Verifier::default();
        assert_eq!(
            verifier.certify(&polylines.curves).0.clone(),
            *verifier.certify(&set).0,
            "{file}"
        );
    }
}
