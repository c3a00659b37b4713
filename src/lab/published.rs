//! Table 1 of Qu & James 2021 (*Fast Linking Numbers for Topology Verification of Loopy
//! Structures*, ACM Transactions on Graphics 40(4)), as published.

use super::inputs::{self, Input};
use serde::Serialize;

/// Machine of the published times (section 4.1).
pub const MACHINE: &str = "18-core Intel Xeon E5-2697 v4 at 2.3 GHz; GPU: NVIDIA GeForce GTX 1080";

/// Row of the table. Times are in seconds; errors are absolute. `None` stands for "N/A": longer
/// than half an hour, or too large for the memory.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Published {
    /// Name of the model; lambda and nu are spelled out.
    pub model: &'static str,
    /// Models for this row in this project.
    #[serde(skip)]
    pub inputs: &'static [Input],
    /// Number of segments.
    pub segments: u64,
    /// Number of curves.
    pub curves: u64,
    /// Number of potential links.
    pub potential_links: u64,
    /// Time of the search for potential links.
    pub search_s: f64,
    /// Time to convert splines to polylines.
    pub discretization_s: f64,
    /// Time of direct summation.
    pub direct_s: Option<f64>,
    /// Time of counting crossings, with a direction chosen by approximate nearest neighbours.
    pub crossings_ann_s: Option<f64>,
    /// Time of counting crossings, with a random direction.
    pub crossings_s: Option<f64>,
    /// Time of Barnes-Hut: beta from 2 to 10, target 0.2.
    pub barnes_hut_s: Option<f64>,
    /// Time of the fast multipole method.
    pub fmm_s: Option<f64>,
    /// Time of direct summation on a GPU.
    pub gpu_direct_s: Option<f64>,
    /// Time of Barnes-Hut on a GPU.
    pub gpu_barnes_hut_s: Option<f64>,
    /// Error of Barnes-Hut.
    pub barnes_hut_error: Option<f64>,
    /// Error of Barnes-Hut on a GPU.
    pub gpu_barnes_hut_error: Option<f64>,
    /// Error of the fast multipole method.
    pub fmm_error: Option<f64>,
}

/// Source of a model in this project.
#[derive(Clone, Copy, Debug)]
pub enum Source {
    /// A generated scene.
    Scene(&'static str),
    /// A file in a folder of models, for models that cannot be generated.
    File(&'static str),
}

/// Seven times: direct, crossings twice, Barnes-Hut, fast multipole method, and both on the GPU.
type Times = [Option<f64>; 7];
/// Three errors: Barnes-Hut, the same on the GPU, fast multipole method.
type Errors = [Option<f64>; 3];

const NA: Option<f64> = None;

const fn s(seconds: f64) -> Option<f64> {
    Some(seconds)
}

const fn row(
    (model, inputs): (&'static str, &'static [Input]),
    [segments, curves, potential_links]: [u64; 3],
    [search_s, discretization_s]: [f64; 2],
    times: Times,
    errors: Errors,
) -> Published {
    Published {
        model,
        inputs,
        segments,
        curves,
        potential_links,
        search_s,
        discretization_s,
        direct_s: times[0],
        crossings_ann_s: times[1],
        crossings_s: times[2],
        barnes_hut_s: times[3],
        fmm_s: times[4],
        gpu_direct_s: times[5],
        gpu_barnes_hut_s: times[6],
        barnes_hut_error: errors[0],
        gpu_barnes_hut_error: errors[1],
        fmm_error: errors[2],
    }
}

/// Rows in the published order.
#[rustfmt::skip]
pub const TABLE_1: [Published; 21] = [
    row(("Alien Sweater (Initial)", inputs::ALIEN_INITIAL),
        [139_506, 146, 1335], [0.013, 0.059],
        [s(11.1), s(12.6), s(0.34), s(0.32), s(1.09), s(0.63), s(0.27)],
        [s(3e-3), s(2e-3), s(1e-3)]),
    row(("Alien Sweater (Final)", inputs::ALIEN_FINAL),
        [139_506, 146, 2426], [0.017, 0.050],
        [s(13.9), s(22.4), s(0.38), s(1.18), s(1.61), s(1.01), s(0.63)],
        [s(3e-3), s(8e-4), s(1e-3)]),
    row(("Sheep Sweater", inputs::SHEEP),
        [729_628, 549, 4951], [0.024, 0.152],
        [s(169.0), s(95.5), s(0.85), s(1.31), s(5.85), s(4.34), s(0.96)],
        [s(2e-3), s(5e-3), s(3e-3)]),
    row(("Sweater", inputs::SWEATER),
        [271_902, 253, 2985], [0.015, 0.120],
        [s(29.3), s(33.0), s(0.29), s(0.74), s(2.33), s(1.43), s(0.56)],
        [s(3e-3), s(2e-3), s(9e-4)]),
    row(("Glove", inputs::GLOVE),
        [58_537, 70, 1022], [0.012, 0.046],
        [s(2.71), s(8.49), s(0.10), s(0.14), s(0.56), s(0.35), s(0.16)],
        [s(2e-3), s(2e-3), s(4e-4)]),
    row(("Knit Tube (Initial)", inputs::KNIT_INITIAL),
        [18_228, 39, 233], [0.012, 0.032],
        [s(0.21), s(1.01), s(0.07), s(0.05), s(0.09), s(0.02), s(0.08)],
        [s(4e-3), s(9e-4), s(1e-3)]),
    row(("Knit Tube (Final)", inputs::KNIT_FINAL),
        [18_228, 39, 180], [0.012, 0.082],
        [s(0.30), s(1.03), s(0.06), s(0.08), s(0.11), s(0.30), s(0.12)],
        [s(6e-3), s(3e-4), s(3e-3)]),
    row(("Chainmail (Initial)", inputs::CHAINMAIL_INITIAL),
        [211_680, 14_112, 18_781], [0.028, 0.070],
        [s(0.04), s(1.85), s(0.03), s(0.09), s(0.10), s(1.20), NA],
        [s(1e-3), NA, s(5e-4)]),
    row(("Chainmail (Final)", inputs::CHAINMAIL_FINAL),
        [211_680, 14_112, 61_417], [0.056, 0.086],
        [s(0.11), s(6.30), s(0.07), s(0.15), s(0.17), s(3.91), NA],
        [s(3e-4), NA, s(7e-4)]),
    row(("Chevron 3x3", inputs::CHEVRON),
        [11_741, 32, 58], [0.013, 0.049],
        [s(0.19), s(0.44), s(0.02), s(0.07), s(0.06), s(0.02), s(0.03)],
        [s(5e-3), s(2e-4), s(1e-3)]),
    row(("Rubber Bands", inputs::BANDS),
        [51_200, 1024, 20_520], [0.018, 0.035],
        [s(0.23), s(7.99), s(0.05), s(0.12), s(0.16), s(1.11), s(1.87)],
        [s(7e-4), s(2e-5), s(5e-4)]),
    row(("Double Helix Ribbon, lambda 10", inputs::RIBBON),
        [200_000, 2, 1], [0.018, 0.076],
        [s(177.0), s(5.60), s(0.06), s(0.15), s(0.34), s(0.48), s(0.02)],
        [s(7e-3), s(1e-3), s(1e-4)]),
    row(("Double Helix Ribbon, lambda 10^3", inputs::RIBBON_TWISTED),
        [200_000, 2, 1], [0.016, 0.112],
        [s(177.0), s(1.82), s(0.07), s(1.62), s(0.55), s(0.48), s(0.03)],
        [s(0.22), s(7e-2), s(0.37)]),
    row(("Double Helix Ribbon, lambda 10, 2E7", inputs::LONG_RIBBON),
        [20_000_000, 2, 1], [0.465, 6.816],
        [NA, s(131.0), s(8.62), s(11.8), NA, NA, s(2.63)],
        [s(3e-2), s(5e-4), NA]),
    row(("Double Helix Ribbon, lambda 10^3, 2E7", inputs::LONG_RIBBON_TWISTED),
        [20_000_000, 2, 1], [0.441, 6.816],
        [NA, s(118.0), s(9.51), s(31.3), NA, NA, s(5.30)],
        [s(0.17), s(0.15), NA]),
    row(("Thick Square Link", inputs::SQUARE),
        [500_000, 1250, 410_000], [0.054, 0.146],
        [s(161.0), NA, s(31.1), s(6.83), s(37.6), s(26.4), s(23.2)],
        [s(1e-3), s(6e-4), s(1e-4)]),
    row(("Thick Square Link, 4E6", inputs::LARGE_SQUARE),
        [4_000_000, 5000, 6_400_000], [0.531, 1.874],
        [NA, NA, s(105.0), s(145.0), s(830.0), s(1844.0), NA],
        [s(2e-3), NA, s(2e-4)]),
    row(("Torus, lambda 10^6", inputs::TORUS),
        [20_000_000, 2, 1], [0.456, 7.027],
        [NA, s(100.3), s(9.30), s(13.9), s(22.2), NA, s(4.94)],
        [s(5e-3), s(6e2), s(9e-4)]),
    row(("Torus, lambda 0", inputs::TORUS_ZERO),
        [40_000_000, 4, 6], [0.519, 7.698],
        [NA, NA, s(55.1), s(18.3), NA, NA, NA],
        [s(3e-3), NA, NA]),
    row(("Woundball, nu 10^3", inputs::WOUNDBALL),
        [1_000_000, 2, 1], [0.048, 0.387],
        [NA, s(6.93), s(0.55), s(0.68), s(1.32), s(12.0), s(0.14)],
        [s(6e-2), s(1e-2), s(2e-5)]),
    row(("Woundball, nu 10^4", inputs::WOUNDBALL_DENSE),
        [2_000_000, 2, 1], [0.056, 0.756],
        [NA, s(43.9), s(7.96), s(15.3), s(5.19), s(47.7), s(90.0)],
        [s(1e-2), s(5e-4), s(7e-6)]),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Models of up to a few hundred thousand segments are built; the others have the parameters.
    #[test]
    fn generated_models_have_about_the_published_sizes() {
        let scenes = |p: &Published| {
            let inputs = p.inputs.iter().filter_map(|input| match input.source {
                Source::Scene(text) => Some((text, input.differs.is_none())),
                Source::File(_) => None,
            });
            inputs.collect::<Vec<_>>()
        };
        for p in TABLE_1 {
            for (text, own) in scenes(&p) {
                let scene: crate::scenes::Scene = text.parse().unwrap();
                let near = |found: u64, published: u64| {
                    let most = if own { 0 } else { published / 100 };
                    let off = found.abs_diff(published);
                    assert!(off <= most, "{}: {found}, not {published}", p.model);
                };
                if p.segments > 600_000 {
                    near(scene.value("segments").unwrap() as u64, p.segments);
                    continue;
                }
                let built = scene.build().unwrap();
                near(built.curves.segments() as u64, p.segments);
                assert_eq!(built.curves.len() as u64, p.curves, "{}", p.model);
                let links = &built.certificate.links;
                match p.model.split_once("lambda ") {
                    Some((_, "10")) => assert_eq!(links[0].lambda, 10),
                    Some((_, "10^3")) => assert_eq!(links[0].lambda, 1000),
                    _ if p.model == "Thick Square Link" => {
                        assert_eq!(links.len() as u64, p.curves * p.curves / 4);
                    }
                    _ => {}
                }
            }
        }
    }

    #[test]
    fn every_row_has_a_scene_or_a_file_that_an_example_makes() {
        let script = include_str!("../../examples/table1.sh");
        for p in TABLE_1 {
            for input in p.inputs {
                if let (Source::File(name), Some(_)) = (input.source, input.differs) {
                    assert!(script.contains(name), "{}: {name}", p.model);
                }
            }
            // The glove is one of the public models.
            let others = p
                .inputs
                .iter()
                .any(|input| input.differs.is_some() || matches!(input.source, Source::Scene(_)));
            assert!(others || p.model == "Glove", "{}", p.model);
        }
    }
}
