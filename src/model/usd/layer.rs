//! Prims and attributes of a USD layer, as far as curves need them. Values stay in the file: a
//! [`Place`] finds one.

use super::FORMAT;
use crate::error::{Error, Result};
use std::sync::Arc;

/// Maximum number of bytes of a token, a name of a prim or a string that is read. Names of curves
/// have the same limit.
pub(super) const WORD_BYTES: usize = 255;

/// Maximum number of attributes of a prim that are read. They are found by their names one after
/// the other.
pub(super) const ATTRIBUTES: usize = 1024;

/// Position of a value in its file; its meaning is that of the reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place(pub u64);

/// A value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// `None`: the attribute has no value.
    Blocked,
    /// Tokens or strings, one or an array.
    Words(Vec<String>),
    Ints(Vec<i32>),
    /// Numbers in single precision, so many per element. Half precision is converted to it.
    Singles(usize, Vec<f32>),
    /// Numbers in double precision, so many per element.
    Doubles(usize, Vec<f64>),
}

impl Value {
    /// Returns the type in words.
    pub fn describe(&self) -> String {
        match self {
            Value::Blocked => "no value".into(),
            Value::Words(_) => "tokens or strings".into(),
            Value::Ints(_) => "integers".into(),
            Value::Singles(n, _) => format!("{n} single precision numbers an element"),
            Value::Doubles(n, _) => format!("{n} double precision numbers an element"),
        }
    }
}

/// A type of values that is read, by its name in USD.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Words,
    Ints,
    Singles(usize),
    Doubles(usize),
}

impl Kind {
    /// Returns the type with this name, with `[]` for arrays or without.
    pub fn named(name: &str) -> Result<Kind> {
        Ok(match name.strip_suffix("[]").unwrap_or(name) {
            "token" | "string" => Kind::Words,
            "int" => Kind::Ints,
            "float" | "half" => Kind::Singles(1),
            "double" => Kind::Doubles(1),
            "point3f" | "float3" | "vector3f" | "normal3f" | "point3h" | "half3" => {
                Kind::Singles(3)
            }
            "point3d" | "double3" | "vector3d" => Kind::Doubles(3),
            "quatf" | "quath" => Kind::Singles(4),
            "quatd" => Kind::Doubles(4),
            "matrix4d" | "frame4d" => Kind::Doubles(16),
            other => {
                return Err(Error::unsupported(
                    FORMAT,
                    format!("values of type {other}"),
                ));
            }
        })
    }
}

/// Times and values.
pub(super) type Samples = Arc<[(f64, Place)]>;

/// An attribute of a prim.
#[derive(Clone, Debug, Default)]
pub(super) struct Attribute {
    pub name: String,
    /// Name of the type, `point3f[]` for example.
    pub kind: String,
    /// Value without a time.
    pub default: Option<Place>,
    /// Times, strictly increasing, and values. Attributes of binary files may share them.
    pub samples: Samples,
    /// Rule that assigns the elements to the curves, if the file states it.
    pub interpolation: Option<String>,
    /// True if the value is a spline over time.
    pub spline: bool,
}

impl Attribute {
    /// Returns true if curves need an attribute of this name. All others are skipped.
    pub fn matters(name: &str) -> bool {
        const NAMES: [&str; 13] = [
            "points",
            "curveVertexCounts",
            "type",
            "basis",
            "wrap",
            "widths",
            "primvars:widths",
            "primvars:widths:indices",
            "primvars:skel:jointIndices",
            "purpose",
            "xformOpOrder",
            NAMES_OF_CURVES,
            TIME,
        ];
        NAMES.contains(&name) || name.starts_with("xformOp:")
    }
}

/// Attribute of a prim of linkwatch's own files: the name of each curve.
pub(super) const NAMES_OF_CURVES: &str = "linkwatch:names";
/// Attribute of the first prim of linkwatch's own files: the time of each frame in seconds.
pub(super) const TIME: &str = "linkwatch:time";

/// A prim. Parents come before their children.
#[derive(Clone, Debug, Default)]
pub(super) struct Prim {
    pub name: String,
    pub parent: Option<usize>,
    /// True if it is defined (`def`), false for `over` and `class`.
    pub defined: bool,
    pub inactive: bool,
    /// Name of its type, `BasisCurves` for example.
    pub kind: String,
    /// Composition that adds content of other places, in words.
    pub arc: Option<&'static str>,
    pub attributes: Vec<Attribute>,
}

impl Prim {
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|a| a.name == name)
    }
}

/// Content of a file.
#[derive(Debug, Default)]
pub(super) struct Layer {
    pub time_codes_per_second: Option<f64>,
    pub frames_per_second: Option<f64>,
    /// Composition of the whole layer, in words.
    pub arc: Option<&'static str>,
    pub prims: Vec<Prim>,
}

impl Layer {
    /// Returns the path of a prim, shortened from the left if it is very long.
    pub fn path(&self, prim: usize) -> String {
        let mut names = Vec::new();
        let mut bytes = 0;
        let mut next = Some(prim);
        while let Some(k) = next {
            let prim = &self.prims[k];
            bytes += prim.name.len() + 1;
            names.push(prim.name.as_str());
            next = prim.parent.filter(|_| bytes <= 4 * WORD_BYTES);
        }
        let start = if next.is_none() && bytes <= 4 * WORD_BYTES {
            "/"
        } else {
            "../"
        };
        names.reverse();
        start.to_owned() + &names.join("/")
    }
}

/// Returns the words for a composition arc with this name in a file, or `None` if the name is that
/// of something else.
pub(super) fn arc(field: &str) -> Option<&'static str> {
    Some(match field {
        "references" => "references",
        "payload" => "a payload",
        "inherits" | "inheritPaths" => "inherits",
        "specializes" => "specializes",
        "variantSets" | "variantSetNames" => "variants",
        _ if field.starts_with("clip") => "value clips",
        "subLayers" => "sublayers",
        "relocates" | "layerRelocates" => "relocates",
        _ => return None,
    })
}

/// Checks that times increase, and are finite.
pub(super) fn check_times(samples: &[(f64, Place)]) -> Result<(), String> {
    let bad = samples.iter().position(|s| !s.0.is_finite());
    let unsorted = samples.windows(2).position(|w| w[0].0 >= w[1].0);
    match (bad, unsorted) {
        (Some(k), _) => Err(format!("time code {}", samples[k].0)),
        (None, Some(k)) => Err(format!(
            "time code {} after {}",
            samples[k + 1].0,
            samples[k].0
        )),
        (None, None) => Ok(()),
    }
}
