//! Scenes: structures of any size whose linking numbers follow from their construction.
//!
//! Most of them are the stress tests of Qu & James 2021 (figure 6 and table 1). A scene is
//! described by one string, a name and the parameters that differ from their defaults. The same
//! string gives the same curves:
//!
//! ```
//! use linkwatch::scenes::Scene;
//!
//! let scene: Scene = "ribbon:segments=2000,lambda=-10".parse()?;
//! let generated = scene.build()?;
//! assert_eq!(generated.curves.segments(), 2000);
//! assert_eq!(generated.certificate.links()[0].lambda, -10);
//! # Ok::<(), linkwatch::Error>(())
//! ```
//!
//! The certificate comes from the construction, not from a kernel, so kernels can be compared with
//! it. It holds for the curves as stored, in single precision and with straight chords (or splines)
//! in place of the curves of the construction: see [`Scene::build`].
//!
//! Signs follow one rule: a curve counts +1 if it goes through a disc towards the side from which
//! the boundary of the disc runs counterclockwise. This is the sign of Arai's sum (see
//! [`crate::kernels`]).
//!
//! [`Frames`] and [`MovingScene`] move a scene, or any other set of curves; [`pull_throughs`] break
//! it.

mod chainmail;
mod frames;
mod isotopy;
mod knit;
mod motion;
mod moving;
mod pen;
mod pull_through;
mod ribbon;
mod rubber_bands;
mod square_link;
mod torus_link;
mod torus_zero;
mod woundball;

pub use frames::Frames;
pub use motion::{Motion, MotionKind};
pub use moving::MovingScene;
pub use pull_through::{Pull, pull_throughs};

use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::verdict::Link;
use std::fmt;
use std::str::FromStr;

/// All scenes that can be built.
pub static KINDS: [Kind; 8] = [
    chainmail::KIND,
    knit::KIND,
    ribbon::KIND,
    rubber_bands::KIND,
    square_link::KIND,
    torus_link::KIND,
    torus_zero::KIND,
    woundball::KIND,
];

/// Maximum number of segments of a scene: a curve of a BCC file has no more points.
const MOST_SEGMENTS: i64 = i32::MAX as i64;

/// Kind of a scene, with its name and its parameters.
#[derive(Debug, serde::Serialize)]
pub struct Kind {
    /// Name of the kind.
    pub name: &'static str,
    /// Description and purpose.
    pub purpose: &'static str,
    /// Parameters of the kind.
    pub parameters: &'static [Parameter],
    #[serde(skip)]
    build: fn(&Scene) -> Result<Generated>,
}

/// Parameter of a scene.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Parameter {
    /// Name of the parameter.
    pub name: &'static str,
    /// Meaning of the parameter, with its unit if it has one.
    pub meaning: &'static str,
    /// Default value.
    pub default: f64,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// True if the value is an integer.
    pub integer: bool,
}

impl Parameter {
    const fn integer(name: &'static str, default: i64, min: i64, max: i64) -> Parameter {
        Parameter {
            integer: true,
            ..Parameter::real(name, default as f64, min as f64, max as f64)
        }
    }

    const fn real(name: &'static str, default: f64, min: f64, max: f64) -> Parameter {
        Parameter {
            name,
            meaning: "",
            default,
            min,
            max,
            integer: false,
        }
    }

    const fn is(self, meaning: &'static str) -> Parameter {
        Parameter { meaning, ..self }
    }

    /// Parses a value, or returns an error text.
    fn parse(&self, text: &str) -> Result<f64, String> {
        let Parameter { name, min, max, .. } = self;
        let kind = if self.integer {
            "an integer"
        } else {
            "a number"
        };
        match text.parse::<f64>() {
            Ok(x) if (*min..=*max).contains(&x) && (!self.integer || x.fract() == 0.0) => Ok(x),
            _ => Err(format!(
                "{name} is '{}'; expected {kind} from {min} to {max}",
                clip(text)
            )),
        }
    }
}

/// Description of a scene: its kind, and a value for each parameter.
///
/// Parsed from `NAME` or `NAME:KEY=VALUE,KEY=VALUE`; integers may be written as `2e7`. Its
/// `Display` form has all parameters, so that the text keeps its meaning if defaults change.
#[derive(Clone, Debug)]
pub struct Scene {
    kind: &'static Kind,
    /// Values in the order of the parameters of the kind.
    values: Vec<f64>,
}

impl PartialEq for Scene {
    fn eq(&self, other: &Scene) -> bool {
        self.kind.name == other.kind.name && self.values == other.values
    }
}

/// A generated scene.
#[derive(Clone, Debug)]
pub struct Generated {
    /// Curves of the scene, all of them closed, in single precision.
    pub curves: CurveSet,
    /// Exact linking numbers of the curves.
    pub certificate: Certificate,
}

impl Generated {
    /// Creates a scene with these nonzero linking numbers, sorted by pair.
    fn new(curves: CurveSet, links: Vec<Link>) -> Generated {
        let certificate = Certificate {
            curves: curves.len(),
            links,
            ..Certificate::default()
        };
        Generated {
            curves,
            certificate,
        }
    }

    /// Creates a scene of two curves with this linking number.
    fn pair(curves: CurveSet, lambda: i64) -> Generated {
        let link = Link { i: 0, j: 1, lambda };
        let links = if lambda == 0 { vec![] } else { vec![link] };
        Generated::new(curves, links)
    }
}

impl Scene {
    /// Returns the kind of the scene.
    pub fn kind(&self) -> &'static Kind {
        self.kind
    }

    /// Returns the value of a parameter, or `None` if the scene has no such parameter.
    pub fn value(&self, name: &str) -> Option<f64> {
        let at = self.kind.parameters.iter().position(|p| p.name == name)?;
        Some(self.values[at])
    }

    /// Builds the curves and their exact certificate.
    ///
    /// The curves of a construction keep a minimum distance. The stored curves deviate from them by
    /// the height of an arc over its chord, and by the rounding to single precision. If both curves
    /// of a pair together deviate by less than their distance, they can be moved into the stored
    /// ones along straight lines without meeting, so their linking number is the same. Parameters
    /// for which this is not certain are rejected ([`Error::Scene`]), as are scenes of too many
    /// points ([`Error::Count`]).
    ///
    /// # Errors
    ///
    /// [`Error::Scene`], [`Error::Count`].
    pub fn build(&self) -> Result<Generated> {
        (self.kind.build)(self)
    }

    /// # Panics
    /// If the scene's own table lacks the parameter.
    fn real(&self, name: &str) -> f64 {
        self.value(name).expect("the scene has this parameter")
    }

    fn integer(&self, name: &str) -> i64 {
        self.real(name) as i64
    }

    fn count(&self, name: &str) -> usize {
        self.real(name) as usize
    }

    /// Creates the error of a scene that cannot be built.
    fn error(&self, what: impl Into<String>) -> Error {
        Error::Scene {
            scene: self.to_string(),
            what: what.into(),
        }
    }

    /// Fails if curves at distance `gap` may meet, because the two stored ones of a pair together
    /// deviate from them by up to `off`.
    fn check_gap(&self, gap: f64, off: f64, advice: &str) -> Result<()> {
        if off < gap {
            return Ok(());
        }
        Err(self.error(format!(
            "its curves are only {gap:.1e} apart, but two polygons may deviate from them by \
                 {off:.1e}: {advice}"
        )))
    }
}

impl FromStr for Scene {
    type Err = Error;

    fn from_str(text: &str) -> Result<Scene> {
        let (name, arguments) = text.split_once(':').unzip();
        let name = name.unwrap_or(text);
        let wrong = |what: String| Error::Scene {
            scene: clip(text),
            what,
        };
        let Some(kind) = KINDS.iter().find(|k| k.name == name) else {
            let known: Vec<&str> = KINDS.iter().map(|k| k.name).collect();
            return Err(wrong(format!("unknown {}", hint(name, &known))));
        };
        let mut given = vec![None; kind.parameters.len()];
        for argument in arguments.into_iter().flat_map(|a| a.split(',')) {
            let Some((key, value)) = argument.split_once('=') else {
                return Err(wrong(format!("'{}', expected key=value", clip(argument))));
            };
            let Some(at) = kind.parameters.iter().position(|p| p.name == key) else {
                let known: Vec<&str> = kind.parameters.iter().map(|p| p.name).collect();
                let (key, hint) = (clip(key), hint(key, &known));
                return Err(wrong(format!("unknown parameter '{key}' {hint}")));
            };
            let value = kind.parameters[at].parse(value).map_err(wrong)?;
            if given[at].replace(value).is_some() {
                return Err(wrong(format!("{key} is given twice")));
            }
        }
        let values = given.iter().zip(kind.parameters);
        let values = values.map(|(v, p)| v.unwrap_or(p.default)).collect();
        Ok(Scene { kind, values })
    }
}

impl fmt::Display for Scene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.kind.name)?;
        for (k, (p, value)) in self.kind.parameters.iter().zip(&self.values).enumerate() {
            let separator = if k == 0 { ':' } else { ',' };
            write!(f, "{separator}{}={value}", p.name)?;
        }
        Ok(())
    }
}

/// Returns a part of a text for a message, short and with control characters escaped.
fn clip(text: &str) -> String {
    text.chars().take(60).flat_map(char::escape_debug).collect()
}

/// Returns the known names, and the one most similar to a misspelt name.
fn hint(word: &str, known: &[&str]) -> String {
    /// Similarity, from 0 to 1, from which a name is suggested.
    const MIN_SIMILARITY: f64 = 0.8;
    let word = word.to_lowercase();
    let alike = known.iter();
    let alike = alike.map(|name| (strsim::jaro_winkler(&word, name), name));
    let nearest = alike.max_by(|a, b| a.0.total_cmp(&b.0));
    let nearest = nearest.filter(|(likeness, _)| *likeness > MIN_SIMILARITY);
    let nearest = nearest.map(|(_, name)| format!("; the nearest is '{name}'"));
    let nearest = nearest.unwrap_or_default();
    format!("(known: {}){nearest}", known.join(", "))
}

/// Returns an upper bound of the distance by which rounding to single precision moves a point whose
/// coordinates are at most `extent`. Each coordinate moves by at most `2^-24` of itself, so a point
/// by `sqrt(3) 2^-24` of it. The rest covers the errors of the double precision in which
/// coordinates are computed.
fn rounding(extent: f64) -> f64 {
    const TWO_TO_MINUS_23: f64 = f32::EPSILON as f64;
    extent * TWO_TO_MINUS_23
}

/// Returns an upper bound of the distance of the chords of a curve from the curve. Its second
/// derivative is at most `acceleration`, and chords join points whose parameters are `step` apart.
fn sagitta(step: f64, acceleration: f64) -> f64 {
    step * step / 8.0 * acceleration
}

#[cfg(test)]
mod tests;
