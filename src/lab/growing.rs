//! Scenes of growing size, to find the size from which on an adapter is faster than the CPU.

use crate::kernels::Method;

/// One scene in growing sizes, for one kernel.
#[derive(Clone, Copy, Debug)]
pub struct GrowingScenes {
    /// Kernel.
    pub kernel: Method,
    /// Name of the scene.
    pub scene: &'static str,
    /// Parameters for a hardware adapter, and smaller ones for a software renderer.
    parameters: [[&'static str; 3]; 2],
}

impl GrowingScenes {
    /// Scenes for each kernel that runs on adapters.
    pub const ALL: [GrowingScenes; 5] = [
        GrowingScenes {
            kernel: Method::Crossings,
            scene: "chainmail",
            parameters: [
                [
                    "rows=14,columns=21",
                    "rows=56,columns=84",
                    "rows=224,columns=336",
                ],
                [
                    "rows=7,columns=10",
                    "rows=20,columns=30",
                    "rows=56,columns=84",
                ],
            ],
        },
        GrowingScenes {
            kernel: Method::Crossings,
            scene: "square_link",
            parameters: [
                [
                    "loops=60,segments=6000",
                    "loops=300,segments=100000",
                    "loops=1250,segments=500000",
                ],
                [
                    "loops=20,segments=2000",
                    "loops=60,segments=6000",
                    "loops=200,segments=40000",
                ],
            ],
        },
        GrowingScenes {
            kernel: Method::Crossings,
            scene: "torus_link",
            parameters: [
                [
                    "segments=20000,toroidal=50,poloidal=50",
                    "segments=400000,toroidal=200,poloidal=200",
                    "segments=4000000,toroidal=500,poloidal=500",
                ],
                [
                    "segments=2000,toroidal=10,poloidal=10",
                    "segments=10000,toroidal=50,poloidal=50",
                    "segments=40000,toroidal=100,poloidal=100",
                ],
            ],
        },
        GrowingScenes {
            kernel: Method::Direct,
            scene: "ribbon",
            parameters: [
                ["segments=2000", "segments=20000", "segments=200000"],
                ["segments=500", "segments=2000", "segments=10000"],
            ],
        },
        GrowingScenes {
            kernel: Method::BarnesHut,
            scene: "knit",
            parameters: [
                [
                    "rows=10,stitches=40,segments=4000",
                    "rows=40,stitches=100,segments=48000",
                    "rows=250,stitches=90,segments=270000",
                ],
                [
                    "rows=3,stitches=16,segments=480",
                    "rows=10,stitches=40,segments=4000",
                    "rows=20,stitches=60,segments=14400",
                ],
            ],
        },
    ];

    /// Returns the scenes, the smallest first. They are smaller for a software renderer.
    pub fn inputs(&self, software: bool) -> [String; 3] {
        self.parameters[usize::from(software)].map(|p| format!("{}:{p}", self.scene))
    }
}

/// Returns the size from which on all are faster. `measured` has the size of each scene, the
/// smallest first, and whether the adapter was faster.
pub fn faster_from(measured: &[(u64, bool)]) -> Option<u64> {
    let slower = measured.iter().rposition(|&(_, faster)| !faster);
    let first = slower.map_or(0, |k| k + 1);
    measured.get(first).map(|&(size, _)| size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::Scene;

    #[test]
    fn a_larger_scene_that_is_slower_again_discards_the_size() {
        assert_eq!(faster_from(&[(1, false), (2, true), (3, true)]), Some(2));
        assert_eq!(faster_from(&[(1, true), (2, false), (3, true)]), Some(3));
        assert_eq!(faster_from(&[(1, true), (2, true)]), Some(1));
        assert_eq!(faster_from(&[(1, true), (2, false)]), None);
        assert_eq!(faster_from(&[]), None);
    }

    #[test]
    fn the_scenes_exist_and_grow() {
        for scenes in &GrowingScenes::ALL {
            for software in [false, true] {
                let sizes = scenes.inputs(software).map(|input| {
                    let scene: Scene = input.parse().expect(&input);
                    scene.build().expect(&input).curves.segments()
                });
                assert!(sizes.is_sorted(), "{} {sizes:?}", scenes.scene);
            }
        }
    }
}
