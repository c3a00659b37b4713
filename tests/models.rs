//! Compares the certificates of real models with the expected ones. The models are large and not
//! part of the project. A test without its files is shown as ignored, never as passed.

mod support;

use libtest_mimic::{Arguments, Failed, Trial};
use linkwatch::formats::{self, Format, FrameWriter, Frames, ModelFrame, ReadOptions};
use linkwatch::{Basis, Certificate, Certifier, homotopic_polylines};
use std::path::PathBuf;
use support::trial::trial;

/// Returns the path of a file beside the project.
fn path(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/models");
    folder.join(name)
}

/// Creates a test that needs these files.
fn test(
    name: String,
    files: &[&str],
    run: impl FnOnce() -> Result<(), Failed> + Send + 'static,
) -> Trial {
    let present = files.iter().all(|file| path(file).exists());
    trial(name, present, run)
}

fn certify(file: &str) -> Result<Certificate, Failed> {
    let set = formats::read(&path(file))?;
    let mut certifier = Certifier::default();
    let (certificate, stats) = certifier.certify(&set);
    println!("{file}: {stats:?}");
    assert_eq!(certificate.undefined(), []);
    Ok(certificate.clone())
}

fn equals_the_expected_certificate(model: &'static str) -> Trial {
    let (stem, _) = model.split_once('.').expect("an extension");
    let expected = format!("{stem}.certificate.txt");
    let name = format!("certificate::{model}");
    test(name, &[model, &expected.clone()], move || {
        assert_eq!(certify(model)?, Certificate::read(&path(&expected))?);
        Ok(())
    })
}

fn has_its_linking_numbers((model, expected): (&'static str, &'static str)) -> Trial {
    test(format!("rolfsen_link::{model}"), &[model], move || {
        assert_eq!(certify(model)?.to_string(), expected);
        Ok(())
    })
}

/// Algorithm 3 as published: its counts equal those of verifycurves, and its polylines have the
/// same certificate as the lazy discretization of each pair.
fn has_the_published_polylines(
    (model, overlaps, segments): (&'static str, Option<usize>, Option<usize>),
) -> Trial {
    test(format!("algorithm_3::{model}"), &[model], move || {
        let set = formats::read(&path(model))?;
        let polylines = homotopic_polylines(&set)?;
        println!(
            "{model}: {} overlaps, {} segments, {} passes",
            polylines.overlaps,
            polylines.curves.segments(),
            polylines.passes
        );
        assert_eq!(polylines.curves.basis(), Basis::Polyline);
        assert!(polylines.too_close.is_empty());
        assert!(overlaps.is_none_or(|n| n == polylines.overlaps));
        assert!(segments.is_none_or(|n| n == polylines.curves.segments()));
        let mut certifier = Certifier::default();
        let found = certifier.certify(&polylines.curves).0.clone();
        assert_eq!(found, *certifier.certify(&set).0);
        Ok(())
    })
}

/// Every format that can hold the curves gives them back with the same certificate. Splines become
/// homotopic polylines first.
fn has_its_certificate_in_every_format(model: &'static str) -> Trial {
    test(format!("convert::{model}"), &[model], move || {
        let set = formats::read(&path(model))?;
        let polylines = homotopic_polylines(&set)?.curves;
        let mut certifier = Certifier::default();
        let expected = certifier.certify(&set).0.clone();
        let folder = tempfile::tempdir()?;
        for name in ["a.obj", "a.vect", "a.npy", "a.npz", "b.npz"] {
            let file = folder.path().join(name);
            // The archive has the splines themselves as well.
            let written = if name == "b.npz" { &set } else { &polylines };
            let mut writer = FrameWriter::create(&file, Format::of(&file)?)?;
            writer.frame(&ModelFrame::new(0, Ok(written.clone())))?;
            writer.finish()?;
            let mut options = ReadOptions::default();
            if name == "a.npy" {
                options.counts = Some(polylines.counts().collect());
            }
            let frames: Vec<ModelFrame> =
                Frames::open(&file, &options)?.collect::<Result<_, _>>()?;
            assert_eq!(frames.len(), 1);
            let found = frames.into_iter().next().expect("a frame").curves?;
            assert!(found.counts().eq(written.counts()), "{name}");
            assert_eq!(*certifier.certify(&found).0, expected, "{name}");
        }
        Ok(())
    })
}

fn main() {
    let certificates = [
        "glove.bcc",
        "knittubeinit.bcc",
        "knittubebroken.bcc",
        "houdiniobj.obj",
    ];
    let rolfsen_links = [
        ("2.2.1.vect", "2 # lines: 1\n0,1,1\n"),
        ("4.2.1.vect", "2 # lines: 1\n0,1,-2\n"),
        ("5.2.1.vect", "2 # lines: 0\n"),
        ("6.3.2.vect", "3 # lines: 0\n"),
        ("3.1.vect", "1 # lines: 0\n"),
        ("4.1.vect", "1 # lines: 0\n"),
    ];
    let polylines = [
        ("glove.bcc", Some(3867), Some(65_933)),
        ("knittubebroken.bcc", None, Some(27_530)),
        ("knittubeinit.bcc", None, None),
    ];
    let trials = (certificates
        .map(equals_the_expected_certificate)
        .into_iter())
    .chain(rolfsen_links.map(has_its_linking_numbers))
    .chain(polylines.map(has_the_published_polylines))
    .chain(certificates.map(has_its_certificate_in_every_format))
    .chain(rolfsen_links.map(|(model, _)| has_its_certificate_in_every_format(model)))
    .collect();
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
