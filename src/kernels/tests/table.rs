//! All kernels with their tolerances: the only table of tolerances.

use crate::curve::CurveSet;
use crate::kernels::crossings::{self, Workspace, Workspaces};
#[cfg(feature = "gpu")]
use crate::kernels::gpu;
use crate::kernels::{Accuracy, Counted, Device, Estimate, GpuUse, Method};
use crate::pairs::{Pair, Trees};
use std::collections::HashMap;

/// Function that returns the sums of some pairs of a set.
pub type Sums = fn(&CurveSet, &[Pair]) -> Vec<Estimate>;

/// A kernel with its accuracy and its tolerances.
pub struct Kernel {
    pub method: Method,
    pub accuracy: Accuracy,
    /// Device on which the kernel runs.
    pub device: Device,
    /// Function that is tested instead of the whole kernel.
    pub part: Option<Sums>,
    pub tolerance: Tolerance,
}

/// Tolerances of a kernel. All kernels must have bounds that cover their error, and must return no
/// wrong integer.
pub struct Tolerance {
    /// Maximum bound on pairs of a few dozen segments that are not close to one another.
    pub bound: f64,
    /// Minimum share of decided pairs in general position.
    pub general: f64,
    /// Minimum share of decided pairs of smooth curves of some hundred segments.
    pub smooth: f64,
    /// Minimum share of decided pairs on a few points of a lattice: parallel, collinear, with
    /// repeated vertices.
    pub lattice: f64,
    /// Minimum share of decided pairs that are close: gaps from 1/2 to 2^-59.
    pub close: f64,
    /// Number of random pairs in a quick test.
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

/// Tolerance of the count of crossings.
const COUNTED: Tolerance = Tolerance {
    bound: 0.0,
    general: 1.0,
    smooth: 1.0,
    lattice: 1.0,
    close: 0.999,
    pairs: 3000,
};

pub const CROSSINGS: Kernel = by(Method::Crossings, COUNTED);

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

/// First with a beta, then with the proven bound: the setting of the command.
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

/// With such a low beta that most expansions are wrong.
pub const BARNES_HUT_COARSE: Kernel = barnes_hut(
    Accuracy {
        beta: Some(1.3),
        dipole: true,
        ..DEFAULT
    },
    [0.5, 0.0, 0.5],
);

/// The published method: a second pass if the estimate requires it.
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

/// With such a low order that few node pairs can be expanded.
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

/// Returns a kernel on an adapter, with the tolerances of single precision.
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
        pairs: 300,
        ..COUNTED
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

/// Double precision alone, without single precision before it, with the tolerances of the CPU.
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
    /// Returns the estimates of some pairs of polylines.
    pub fn estimates(&self, set: &CurveSet, pairs: &[Pair]) -> Vec<Estimate> {
        if let Some(part) = self.part {
            return part(set, pairs);
        }
        let mut gpu = GpuUse::open(&self.device, None).expect("an adapter");
        let sum = self.method.summation(set, self.accuracy, &gpu, pairs);
        let found = sum.map(|sum| sum.linking_numbers(pairs));
        let found = found.unwrap_or_else(|| counted(set, pairs, &mut gpu));
        // Without an adapter, the CPU would be tested instead.
        assert_eq!(gpu.info().is_some(), self.device != Device::Cpu);
        found
    }

    /// Returns the estimate of the first two curves.
    pub fn estimate(&self, set: &CurveSet) -> Estimate {
        self.estimates(set, &[(0, 1)])[0]
    }
}

/// Returns counted linking numbers as estimates without an error.
fn counted(set: &CurveSet, pairs: &[Pair], gpu: &mut GpuUse) -> Vec<Estimate> {
    let mut trees = Trees::default();
    trees.refit(set);
    let workspaces = &Workspaces::default();
    let trees = &trees;
    let input = crossings::Input {
        set,
        trees,
        workspaces,
    };
    let on_cpu = || {
        let mut all = Counted::default();
        for &pair in pairs {
            let workspace = &mut Workspace::default();
            all.add(
                pair,
                crossings::linking_number(input, pair, None, workspace),
            );
        }
        vec![all]
    };
    let found = gpu.count(input, pairs).unwrap_or_else(on_cpu);
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
