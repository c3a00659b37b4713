//! All kernels, with what is asked of each beside the truth: the one table of tolerances.

use crate::curve::CurveSet;
use crate::kernels::crossings::{self, Workspace, Workspaces};
#[cfg(feature = "gpu")]
use crate::kernels::gpu;
use crate::kernels::{Accelerator, Accuracy, Counted, Device, Estimate, Method};
use crate::pairs::{Pair, Trees};
use std::collections::HashMap;

/// Sums of some pairs of a set.
pub type Sums = fn(&CurveSet, &[Pair]) -> Vec<Estimate>;

/// A kernel at some accuracy.
pub struct Kernel {
    pub method: Method,
    pub accuracy: Accuracy,
    /// Where it runs.
    pub device: Device,
    /// A part of it alone, in the place of all.
    pub part: Option<Sums>,
    pub tolerance: Tolerance,
}

/// What a kernel must reach. That its bound covers its error, and that no integer is wrong, is asked of all.
pub struct Tolerance {
    /// Largest bound on pairs of a few dozen segments that are not close to one another.
    pub bound: f64,
    /// Least share of the pairs in general position that it decides.
    pub general: f64,
    /// The same of smooth curves of some hundred segments.
    pub smooth: f64,
    /// The same of pairs on a few points of a lattice: parallel, collinear, with repeated vertices.
    pub lattice: f64,
    /// The same of pairs that come as near as rounding: gaps from 1/2 to 2^-59.
    pub close: f64,
    /// Random pairs that a quick test has time for.
    pub pairs: usize,
}

const fn by(method: Method, tolerance: Tolerance) -> Kernel {
    Kernel {
        method,
        accuracy: DEFAULT,
        device: Device::Cpu,
        part: None,
        tolerance,
    }
}

const fn barnes_hut(accuracy: Accuracy, [general, smooth, lattice]: [f64; 3]) -> Kernel {
    Kernel {
        method: Method::BarnesHut,
        accuracy,
        device: Device::Cpu,
        part: None,
        tolerance: Tolerance {
            bound: f64::INFINITY,
            general,
            smooth,
            lattice,
            close: 0.66,
            pairs: 1000,
        },
    }
}

const DEFAULT: Accuracy = Accuracy {
    beta: None,
    target: None,
    dipole: false,
    order: None,
};

pub const CROSSINGS: Kernel = by(
    Method::Crossings,
    Tolerance {
        bound: 0.0,
        general: 1.0,
        smooth: 1.0,
        lattice: 1.0,
        close: 0.999,
        pairs: 3000,
    },
);

pub const DIRECT: Kernel = by(
    Method::Direct,
    Tolerance {
        bound: 1e-6,
        general: 0.999,
        smooth: 1.0,
        lattice: 0.9,
        close: 0.66,
        pairs: 3000,
    },
);

pub const ANGLE_SUM: Kernel = by(
    Method::AngleSum,
    Tolerance {
        bound: 1e-6,
        general: 0.999,
        smooth: 1.0,
        lattice: 0.9,
        close: 0.66,
        pairs: 3000,
    },
);

pub const INTERVAL: Kernel = by(
    Method::Interval,
    Tolerance {
        bound: 1e-7,
        general: 0.999,
        smooth: 1.0,
        lattice: 0.5,
        close: 0.66,
        pairs: 100,
    },
);

/// First by beta, then by the proven bound: what the command uses.
pub const BARNES_HUT: Kernel = by(
    Method::BarnesHut,
    Tolerance {
        bound: 0.8,
        general: 0.99,
        smooth: 1.0,
        lattice: 0.9,
        close: 0.66,
        pairs: 2000,
    },
);

pub const BARNES_HUT_BETA: Kernel = barnes_hut(
    Accuracy {
        beta: Some(3.0),
        ..DEFAULT
    },
    [0.9, 0.5, 0.9],
);

/// So coarse that most of what it expands is wrong.
pub const BARNES_HUT_COARSE: Kernel = barnes_hut(
    Accuracy {
        beta: Some(1.3),
        dipole: true,
        ..DEFAULT
    },
    [0.5, 0.0, 0.5],
);

/// As published: a second pass where the estimate says so.
pub const BARNES_HUT_ESTIMATED: Kernel = barnes_hut(
    Accuracy {
        beta: Some(2.0),
        target: Some(0.2),
        ..DEFAULT
    },
    [0.5, 0.0, 0.5],
);

pub const FMM: Kernel = by(
    Method::Fmm,
    Tolerance {
        bound: 0.8,
        general: 0.99,
        smooth: 1.0,
        lattice: 0.9,
        close: 0.66,
        pairs: 2000,
    },
);

/// Of so low an order that little can be expanded.
pub const FMM_LOW: Kernel = Kernel {
    method: Method::Fmm,
    accuracy: Accuracy {
        order: Some(3),
        ..DEFAULT
    },
    device: Device::Cpu,
    part: None,
    tolerance: Tolerance {
        bound: 0.8,
        general: 0.99,
        smooth: 0.5,
        lattice: 0.9,
        close: 0.66,
        pairs: 1000,
    },
};

/// On an adapter; what is asked there single precision has to reach.
#[cfg(feature = "gpu")]
const fn on_device(method: Method, tolerance: Tolerance) -> Kernel {
    Kernel {
        method,
        accuracy: DEFAULT,
        device: Device::Gpu,
        part: None,
        tolerance,
    }
}

#[cfg(feature = "gpu")]
pub const GPU_CROSSINGS: Kernel = on_device(
    Method::Crossings,
    Tolerance {
        bound: 0.0,
        general: 1.0,
        smooth: 1.0,
        lattice: 1.0,
        close: 0.999,
        pairs: 300,
    },
);

#[cfg(feature = "gpu")]
pub const GPU_DIRECT: Kernel = on_device(
    Method::Direct,
    Tolerance {
        bound: 0.5,
        general: 0.5,
        smooth: 0.2,
        lattice: 0.2,
        close: 0.2,
        pairs: 300,
    },
);

/// Double precision alone, without single precision before it: as much as on the processor.
#[cfg(feature = "gpu")]
pub const GPU_DIRECT_DOUBLE: Kernel = Kernel {
    method: Method::Direct,
    accuracy: DEFAULT,
    device: Device::Gpu,
    part: Some(gpu::direct_in_double),
    tolerance: Tolerance {
        bound: 1e-6,
        general: 0.999,
        smooth: 1.0,
        lattice: 0.9,
        close: 0.66,
        pairs: 300,
    },
};

#[cfg(feature = "gpu")]
pub const GPU_BARNES_HUT: Kernel = on_device(
    Method::BarnesHut,
    Tolerance {
        bound: 1.0,
        general: 0.5,
        smooth: 0.2,
        lattice: 0.2,
        close: 0.2,
        pairs: 300,
    },
);

impl Kernel {
    /// What it says of some pairs of polylines.
    pub fn estimates(&self, set: &CurveSet, pairs: &[Pair]) -> Vec<Estimate> {
        if let Some(part) = self.part {
            return part(set, pairs);
        }
        let mut accelerator = Accelerator::open(&self.device).expect("an adapter");
        let sum = self
            .method
            .summation(set, self.accuracy, &accelerator, pairs);
        let found = sum.map(|sum| sum.linking_numbers(pairs));
        let found = found.unwrap_or_else(|| counted(set, pairs, &mut accelerator));
        // Else this would have tested the processor.
        assert_eq!(accelerator.info().is_some(), self.device != Device::Cpu);
        found
    }

    /// What it says of the first two.
    pub fn estimate(&self, set: &CurveSet) -> Estimate {
        self.estimates(set, &[(0, 1)])[0]
    }
}

/// Counted numbers, as sums without an error.
fn counted(set: &CurveSet, pairs: &[Pair], accelerator: &mut Accelerator) -> Vec<Estimate> {
    let mut trees = Trees::default();
    trees.refit(set);
    let workspaces = &Workspaces::default();
    let trees = &trees;
    let scene = crossings::Scene {
        set,
        trees,
        workspaces,
    };
    let on_processor = || {
        let mut all = Counted::default();
        for &pair in pairs {
            let workspace = &mut Workspace::default();
            all.add(
                pair,
                crossings::linking_number(scene, pair, None, workspace),
            );
        }
        vec![all]
    };
    let found = accelerator.count(scene, pairs).unwrap_or_else(on_processor);
    let found = Counted::joined(found);
    let known = |value| Estimate { value, bound: 0.0 };
    let mut numbers: HashMap<Pair, Estimate> = HashMap::new();
    numbers.extend((found.links.iter()).map(|l| ((l.i, l.j), known(l.lambda as f64))));
    for defect in &found.undefined {
        numbers.insert((defect.i, defect.j.expect("a pair")), Estimate::UNKNOWN);
    }
    let number = |pair| numbers.get(pair).copied().unwrap_or(known(0.0));
    pairs.iter().map(number).collect()
}
