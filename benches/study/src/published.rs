//! Table 1 of Qu & James 2021 (*Fast Linking Numbers for Topology Verification of Loopy
//! Structures*, ACM Transactions on Graphics 40(4)), as published, and the models of its rows here.
//!
//! The published models are files that the user has, or scenes with the published parameters. The
//! garments were not published. In their place stand generated tubes, and models that
//! `examples/table1.sh` simulates and writes to a folder; each says what differs.

/// Machine of the published times (section 4.1).
pub const MACHINE: &str = "18-core Intel Xeon E5-2697 v4 at 2.3 GHz";

/// Row of the table. Times are in seconds; errors are absolute. `None` stands for "N/A": longer
/// than half an hour, or too large for the memory.
pub struct Published {
    /// Name of the model; lambda and nu are spelled out.
    pub model: &'static str,
    /// Models for this row in this project: the published one, or others of about its size.
    pub inputs: &'static [Input],
    /// Numbers of segments, curves and potential links.
    pub sizes: [u64; 3],
    /// Time of direct summation.
    pub direct_s: Option<f64>,
    /// Time of counting crossings, with a random direction.
    pub crossings_s: Option<f64>,
    /// Time of Barnes-Hut: beta from 2 to 10, target 0.2.
    pub barnes_hut_s: Option<f64>,
    /// Time of the fast multipole method.
    pub fmm_s: Option<f64>,
    pub barnes_hut_error: Option<f64>,
    pub fmm_error: Option<f64>,
}

/// Input of a row.
pub struct Input {
    pub source: Source,
    /// Difference from the published model; `None` if this is it.
    pub differs: Option<&'static str>,
}

/// Source of a model in this project.
#[derive(Clone, Copy)]
pub enum Source {
    /// A generated scene.
    Scene(&'static str),
    /// A file in a folder of models.
    File(&'static str),
}

use Source::{File, Scene};

const fn own(source: Source) -> Input {
    Input {
        source,
        differs: None,
    }
}

const fn other(source: Source, differs: &'static str) -> Input {
    Input {
        source,
        differs: Some(differs),
    }
}

const NA: Option<f64> = None;

const fn s(seconds: f64) -> Option<f64> {
    Some(seconds)
}

/// Returns a row. Times: direct, crossings, Barnes-Hut, fast multipole method. Errors: Barnes-Hut,
/// fast multipole method.
const fn row(
    (model, inputs): (&'static str, &'static [Input]),
    sizes: [u64; 3],
    times: [Option<f64>; 4],
    errors: [Option<f64>; 2],
) -> Published {
    Published {
        model,
        inputs,
        sizes,
        direct_s: times[0],
        crossings_s: times[1],
        barnes_hut_s: times[2],
        fmm_s: times[3],
        barnes_hut_error: errors[0],
        fmm_error: errors[1],
    }
}

const TUBE: &str = "a generated knitted tube, no garment";
const GARMENT: &str = "the garment of examples/yarn, a body with two sleeves, before its fall";
const FALLEN: &str =
    "the garment of examples/yarn, a body with two sleeves, after a second of its fall";
const WRUNG: &str = "the tube of examples/yarn, wrung until it breaks, polylines";
const SPACING: &str = "the paper does not give the spacing of the rings";
const PACKED: &str =
    "examples/chainmail --pack, frame 60 of 120: a square sheet of 14,145 rings of 12 segments";
const BANDS: &str = "examples/bands after its fall: 24 segments a band, not 50";

/// Rows in the published order.
#[rustfmt::skip]
pub static TABLE_1: [Published; 21] = [
    row(("Alien Sweater (Initial)", &[
            own(File("aliensweaterinit.bcc")),
            other(File("garment-73x106-initial.bcc"), GARMENT),
            other(Scene("knit:rows=146,stitches=119,segments=138992"), TUBE)]),
        [139_506, 146, 1335], [s(11.1), s(0.34), s(0.32), s(1.09)], [s(3e-3), s(1e-3)]),
    row(("Alien Sweater (Final)", &[
            own(File("aliensweaterfinal.bcc")),
            other(File("garment-73x106-final.bcc"), FALLEN)]),
        [139_506, 146, 2426], [s(13.9), s(0.38), s(1.18), s(1.61)], [s(3e-3), s(1e-3)]),
    row(("Sheep Sweater", &[
            own(File("sheepsweater.bcc")),
            other(File("garment-274x148.bcc"), GARMENT),
            other(Scene("knit:rows=549,stitches=166,segments=729072"), TUBE)]),
        [729_628, 549, 4951], [s(169.0), s(0.85), s(1.31), s(5.85)], [s(2e-3), s(3e-3)]),
    row(("Sweater", &[
            own(File("sweater.bcc")),
            other(File("garment-126x120.bcc"), GARMENT),
            other(Scene("knit:rows=253,stitches=134,segments=271216"), TUBE)]),
        [271_902, 253, 2985], [s(29.3), s(0.29), s(0.74), s(2.33)], [s(3e-3), s(9e-4)]),
    row(("Glove", &[own(File("glove.bcc"))]),
        [58_537, 70, 1022], [s(2.71), s(0.10), s(0.14), s(0.56)], [s(2e-3), s(4e-4)]),
    row(("Knit Tube (Initial)", &[
            own(File("knittubeinit.bcc")),
            other(File("tube-39x39-initial.bcc"), "the tube of examples/yarn, polylines"),
            other(Scene("knit:rows=39,stitches=39,segments=18252"),
                "a generated tube, not relaxed")]),
        [18_228, 39, 233], [s(0.21), s(0.07), s(0.05), s(0.09)], [s(4e-3), s(1e-3)]),
    row(("Knit Tube (Final)", &[
            own(File("knittubebroken.bcc")),
            other(File("tube-39x39-final.bcc"), WRUNG)]),
        [18_228, 39, 180], [s(0.30), s(0.06), s(0.08), s(0.11)], [s(6e-3), s(3e-3)]),
    row(("Chainmail (Initial)", &[other(Scene("chainmail"), SPACING)]),
        [211_680, 14_112, 18_781], [s(0.04), s(0.03), s(0.09), s(0.10)], [s(1e-3), s(5e-4)]),
    row(("Chainmail (Final)", &[
            other(Scene("chainmail:crumple=1"),
                "a generated crumpled sheet, not packed into a box"),
            other(File("packed-69.bcc"), PACKED)]),
        [211_680, 14_112, 61_417], [s(0.11), s(0.07), s(0.15), s(0.17)], [s(3e-4), s(7e-4)]),
    row(("Chevron 3x3", &[
            own(File("chevron.bcc")),
            other(File("tube-32x31.bcc"), "the tube of examples/yarn, plain stitches"),
            other(Scene("knit:rows=32,stitches=46,segments=11776"),
                "a generated tube, plain stitches")]),
        [11_741, 32, 58], [s(0.19), s(0.02), s(0.07), s(0.06)], [s(5e-3), s(1e-3)]),
    row(("Rubber Bands", &[
            other(Scene("rubber_bands"), "a generated pile; the paper does not give the shapes"),
            other(File("bands-final.bcc"), BANDS)]),
        [51_200, 1024, 20_520], [s(0.23), s(0.05), s(0.12), s(0.16)], [s(7e-4), s(5e-4)]),
    row(("Double Helix Ribbon, lambda 10", &[own(Scene("ribbon"))]),
        [200_000, 2, 1], [s(177.0), s(0.06), s(0.15), s(0.34)], [s(7e-3), s(1e-4)]),
    row(("Double Helix Ribbon, lambda 10^3", &[own(Scene("ribbon:lambda=1000"))]),
        [200_000, 2, 1], [s(177.0), s(0.07), s(1.62), s(0.55)], [s(0.22), s(0.37)]),
    row(("Double Helix Ribbon, lambda 10, 2E7", &[own(Scene("ribbon:segments=2e7"))]),
        [20_000_000, 2, 1], [NA, s(8.62), s(11.8), NA], [s(3e-2), NA]),
    row(("Double Helix Ribbon, lambda 10^3, 2E7", &[own(Scene("ribbon:segments=2e7,lambda=1000"))]),
        [20_000_000, 2, 1], [NA, s(9.51), s(31.3), NA], [s(0.17), NA]),
    row(("Thick Square Link", &[own(Scene("square_link"))]),
        [500_000, 1250, 410_000], [s(161.0), s(31.1), s(6.83), s(37.6)], [s(1e-3), s(1e-4)]),
    row(("Thick Square Link, 4E6", &[own(Scene("square_link:loops=5000,segments=4e6"))]),
        [4_000_000, 5000, 6_400_000], [NA, s(105.0), s(145.0), s(830.0)], [s(2e-3), s(2e-4)]),
    row(("Torus, lambda 10^6", &[own(Scene("torus_link"))]),
        [20_000_000, 2, 1], [NA, s(9.30), s(13.9), s(22.2)], [s(5e-3), s(9e-4)]),
    row(("Torus, lambda 0", &[
            other(Scene("torus_zero:segments=4e7,periods=1000"),
                "the paper does not give the number of periods")]),
        [40_000_000, 4, 6], [NA, s(55.1), s(18.3), NA], [s(3e-3), NA]),
    row(("Woundball, nu 10^3", &[own(Scene("woundball"))]),
        [1_000_000, 2, 1], [NA, s(0.55), s(0.68), s(1.32)], [s(6e-2), s(2e-5)]),
    row(("Woundball, nu 10^4", &[own(Scene("woundball:segments=2e6,crossings=10000"))]),
        [2_000_000, 2, 1], [NA, s(7.96), s(15.3), s(5.19)], [s(1e-2), s(7e-6)]),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Models of up to a few hundred thousand segments are built; the others have the parameters.
    #[test]
    fn generated_models_have_about_the_published_sizes() {
        for p in &TABLE_1 {
            for input in p.inputs {
                let Scene(text) = input.source else { continue };
                let scene: linkwatch::scenes::Scene = text.parse().unwrap();
                let near = |found: u64| {
                    let most = input.differs.map_or(0, |_| p.sizes[0] / 100);
                    let off = found.abs_diff(p.sizes[0]);
                    assert!(off <= most, "{}: {found} segments", p.model);
                };
                if p.sizes[0] > 600_000 {
                    near(scene.value("segments").unwrap() as u64);
                    continue;
                }
                let built = scene.build().unwrap();
                near(built.curves.segments() as u64);
                assert_eq!(built.curves.len() as u64, p.sizes[1], "{}", p.model);
            }
        }
    }

    #[test]
    fn every_row_has_a_scene_or_a_file_that_an_example_makes() {
        let script = include_str!("../../../examples/table1.sh");
        for p in &TABLE_1 {
            for input in p.inputs {
                if let (File(name), Some(_)) = (input.source, input.differs) {
                    assert!(script.contains(name), "{}: {name}", p.model);
                }
            }
            // The glove is one of the public models.
            let is_there =
                |input: &Input| input.differs.is_some() || matches!(input.source, Scene(_));
            assert!(
                p.inputs.iter().any(is_there) || p.model == "Glove",
                "{}",
                p.model
            );
        }
    }
}
