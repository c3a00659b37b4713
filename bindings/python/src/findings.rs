//! The findings of a report, as Python objects.

use pyo3::prelude::*;

/// Declares a Python class with public attributes that are read only, and its text.
macro_rules! finding {
    ($(#[$doc:meta])* $name:ident { $($(#[$about:meta])* $field:ident: $kind:ty),* $(,)? }) => {
        $(#[$doc])*
        #[pyclass(frozen, eq, module = "linkwatch")]
        #[derive(Clone, PartialEq)]
        pub struct $name {
            $($(#[$about])* #[pyo3(get)] $field: $kind,)*
            text: String,
        }

        #[pymethods]
        impl $name {
            fn __str__(&self) -> &str {
                &self.text
            }

            fn __repr__(&self) -> String {
                format!("<{}: {}>", stringify!($name), self.text)
            }
        }
    };
}

finding!(
/// The place at which two curves are closest.
Place {
    /// Segment of each curve, from 0.
    segments: [u32; 2],
    /// Midpoint of the shortest connection, in the units of the simulation.
    point: [f64; 3],
    /// Length of the shortest connection.
    distance: f64,
});

finding!(
/// A linking number that differs from the expected one.
Change {
    /// First curve, from 0.
    i: u32,
    /// Second curve.
    j: u32,
    /// Translation of the second curve, in vectors of the periodic cell; zeros without a cell.
    image: (i32, i32, i32),
    /// Linking number of the baseline.
    expected: i64,
    /// Linking number of the frame.
    found: i64,
    /// Place, if it is known.
    place: Option<Place>,
});

finding!(
/// A passage of a curve through another one, or through itself, between two frames.
PullThrough {
    /// First curve, from 0.
    i: u32,
    /// Second curve; equal to the first one if the curve passes through itself.
    j: u32,
    /// Translation of the second curve, in vectors of the periodic cell; zeros without a cell.
    image: (i32, i32, i32),
    /// Segment of each curve, from 0.
    segments: [u32; 2],
    /// Time as a fraction of the step between the frames.
    fraction: f64,
    /// Change of the linking number: 1 or -1.
    sign: i32,
    /// Place, in the units of the simulation.
    point: [f64; 3],
    /// Relative motion in the step, in segment lengths.
    lengths: f64,
});

finding!(
/// A pair of curves, or a curve, that could not be decided or compared.
Defect {
    /// First curve, from 0.
    i: u32,
    /// Second curve; None if the defect concerns one curve.
    j: Option<u32>,
    /// Translation of the second curve, in vectors of the periodic cell; zeros without a cell.
    image: (i32, i32, i32),
    /// Reason: contact, too-close, degenerate, no-baseline, undecided-step or unaccounted.
    kind: String,
    /// Place.
    place: Place,
});

impl From<&linkwatch::Place> for Place {
    fn from(p: &linkwatch::Place) -> Place {
        Place {
            segments: p.segments,
            point: p.point,
            distance: p.distance,
            text: p.to_string(),
        }
    }
}

impl Change {
    /// Converts a change of a scene of this extent, and of curves with these names, if any.
    pub fn new(c: &linkwatch::Change, extent: f64, names: &[String]) -> Change {
        Change {
            i: c.i,
            j: c.j,
            image: c.image.into(),
            expected: c.expected,
            found: c.found,
            place: c.place.as_ref().map(Into::into),
            text: c.sentence_named(extent, names),
        }
    }
}

impl PullThrough {
    /// Converts a pull-through in a scene of this extent, and of curves with these names, if any.
    pub fn new(p: &linkwatch::PullThrough, extent: f64, names: &[String]) -> PullThrough {
        PullThrough {
            i: p.i,
            j: p.j,
            image: p.image.into(),
            segments: p.segments,
            fraction: p.fraction,
            sign: p.sign,
            point: p.point,
            lengths: p.lengths,
            text: p.sentence_named(extent, names),
        }
    }
}

impl Defect {
    /// Converts a defect in a scene of this extent, and of curves with these names, if any.
    pub fn new(d: &linkwatch::Defect, extent: f64, names: &[String]) -> Defect {
        Defect {
            i: d.i,
            j: d.j,
            image: d.image.into(),
            kind: d.kind.word().to_owned(),
            place: (&d.place).into(),
            text: d.sentence_named(extent, names),
        }
    }
}
