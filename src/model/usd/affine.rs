//! Transforms of prims: the operations of `xformOpOrder`, over time.
//!
//! Points are rows: `p' = p A + t`. The last operation of the list is applied first. Conventions
//! are those of `UsdGeomXformOp`: angles in degrees, `rotateXYZ` turns about x first.

use super::FORMAT;
use super::layer::{Prim, Value};
use super::track::{Track, Values};
use crate::curve::Point;
use crate::error::{Error, Result};
use std::io::{Read, Seek};

/// The map `p A + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    a: [[f64; 3]; 3],
    t: [f64; 3],
}

impl Affine {
    pub const IDENTITY: Affine = Affine::diagonal([1.0; 3]);

    const fn diagonal([x, y, z]: [f64; 3]) -> Affine {
        Affine {
            a: [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]],
            t: [0.0; 3],
        }
    }

    fn translation(t: [f64; 3]) -> Affine {
        Affine {
            t,
            ..Affine::IDENTITY
        }
    }

    /// Rotation about an axis, 0 for x, by an angle in degrees.
    fn rotation(axis: usize, degrees: f64) -> Affine {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut map = Affine::IDENTITY;
        (map.a[j][j], map.a[j][k]) = (cos, sin);
        (map.a[k][j], map.a[k][k]) = (-sin, cos);
        map
    }

    /// Rotation by a quaternion, real part first.
    fn quaternion(q: [f64; 4]) -> Affine {
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm == 0.0 {
            return Affine::IDENTITY;
        }
        let [w, x, y, z] = q.map(|x| x / norm);
        Affine {
            a: [
                [
                    1.0 - 2.0 * (y * y + z * z),
                    2.0 * (x * y + w * z),
                    2.0 * (x * z - w * y),
                ],
                [
                    2.0 * (x * y - w * z),
                    1.0 - 2.0 * (x * x + z * z),
                    2.0 * (y * z + w * x),
                ],
                [
                    2.0 * (x * z + w * y),
                    2.0 * (y * z - w * x),
                    1.0 - 2.0 * (x * x + y * y),
                ],
            ],
            t: [0.0; 3],
        }
    }

    /// Returns a matrix whose last column is that of an affine map.
    fn matrix(m: [f64; 16]) -> Option<Affine> {
        let row = |k: usize| [m[4 * k], m[4 * k + 1], m[4 * k + 2]];
        let last = [m[3], m[7], m[11], m[15]];
        (last == [0.0, 0.0, 0.0, 1.0]).then(|| Affine {
            a: [row(0), row(1), row(2)],
            t: row(3),
        })
    }

    #[inline]
    pub fn apply(&self, p: Point) -> Point {
        let mut out = self.t;
        for (k, out) in out.iter_mut().enumerate() {
            *out += p[0] * self.a[0][k] + p[1] * self.a[1][k] + p[2] * self.a[2][k];
        }
        out
    }

    /// Returns this map, followed by `next`.
    pub fn then(&self, next: &Affine) -> Affine {
        let linear = Affine {
            t: [0.0; 3],
            ..*next
        };
        Affine {
            a: self.a.map(|row| linear.apply(row)),
            t: next.apply(self.t),
        }
    }

    fn inverse(&self) -> Option<Affine> {
        let a = &self.a;
        let minor = |i: usize, j: usize| {
            let (r, s, u, v) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
            a[r][u] * a[s][v] - a[r][v] * a[s][u]
        };
        let determinant: f64 = (0..3).map(|j| a[0][j] * minor(0, j)).sum();
        let linear = Affine {
            a: [0, 1, 2].map(|j| [0, 1, 2].map(|i| minor(i, j) / determinant)),
            t: [0.0; 3],
        };
        let t = linear.apply(self.t).map(|x| -x);
        let inverse = Affine { t, ..linear };
        inverse.is_finite().then_some(inverse)
    }

    fn is_finite(&self) -> bool {
        self.a
            .iter()
            .chain([&self.t])
            .flatten()
            .all(|x| x.is_finite())
    }

    /// Returns an upper bound of the factor by which lengths grow. It is that factor, rounded, for
    /// rotations and equal scales on all axes.
    pub fn stretch(&self) -> f64 {
        let a = &self.a;
        let product = |i: usize, j: usize| (0..3).map(|k| a[i][k] * a[j][k]).sum::<f64>().abs();
        let rows = (0..3).map(|i| (0..3).map(|j| product(i, j)).sum::<f64>());
        rows.fold(0.0, f64::max).sqrt()
    }
}

/// Kinds of operations.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// On all axes, or on one.
    Translate(Option<usize>),
    Scale(Option<usize>),
    /// About axes, the first one first.
    Rotate(&'static [usize]),
    Orient,
    Matrix,
}

impl Kind {
    fn named(name: &str) -> Option<Kind> {
        Some(match name {
            "translate" => Kind::Translate(None),
            "translateX" => Kind::Translate(Some(0)),
            "translateY" => Kind::Translate(Some(1)),
            "translateZ" => Kind::Translate(Some(2)),
            "scale" => Kind::Scale(None),
            "scaleX" => Kind::Scale(Some(0)),
            "scaleY" => Kind::Scale(Some(1)),
            "scaleZ" => Kind::Scale(Some(2)),
            "rotateX" => Kind::Rotate(&[0]),
            "rotateY" => Kind::Rotate(&[1]),
            "rotateZ" => Kind::Rotate(&[2]),
            "rotateXYZ" => Kind::Rotate(&[0, 1, 2]),
            "rotateXZY" => Kind::Rotate(&[0, 2, 1]),
            "rotateYXZ" => Kind::Rotate(&[1, 0, 2]),
            "rotateYZX" => Kind::Rotate(&[1, 2, 0]),
            "rotateZXY" => Kind::Rotate(&[2, 0, 1]),
            "rotateZYX" => Kind::Rotate(&[2, 1, 0]),
            "orient" => Kind::Orient,
            "transform" => Kind::Matrix,
            _ => return None,
        })
    }

    /// Returns the map of an operation with this value, or `None` if the value does not fit.
    fn map(self, value: &Value) -> Option<Affine> {
        let numbers: Vec<f64> = match value {
            Value::Singles(_, v) => v.iter().map(|&x| x.into()).collect(),
            Value::Doubles(_, v) => v.clone(),
            _ => return None,
        };
        let one = |default: f64, axis: usize| {
            let mut all = [default; 3];
            all[axis] = *numbers.first()?;
            (numbers.len() == 1).then_some(all)
        };
        let three = || <[f64; 3]>::try_from(&numbers[..]).ok();
        let map = match self {
            Kind::Translate(None) => Affine::translation(three()?),
            Kind::Translate(Some(axis)) => Affine::translation(one(0.0, axis)?),
            Kind::Scale(None) => Affine::diagonal(three()?),
            Kind::Scale(Some(axis)) => Affine::diagonal(one(1.0, axis)?),
            Kind::Rotate(&[axis]) => Affine::rotation(axis, one(0.0, axis)?[axis]),
            Kind::Rotate(axes) => {
                let degrees = three()?;
                let turns = axes
                    .iter()
                    .map(|&axis| Affine::rotation(axis, degrees[axis]));
                turns.fold(Affine::IDENTITY, |map, turn| map.then(&turn))
            }
            Kind::Orient => Affine::quaternion(numbers.try_into().ok()?),
            Kind::Matrix => Affine::matrix(numbers.try_into().ok()?)?,
        };
        map.is_finite().then_some(map)
    }
}

/// One operation.
#[derive(Debug)]
struct Op {
    kind: Kind,
    inverted: bool,
    track: Track,
}

impl Op {
    fn map(&self, value: &Value) -> Result<Affine> {
        let map = self.kind.map(value).and_then(|map| match self.inverted {
            true => map.inverse(),
            false => Some(map),
        });
        map.ok_or_else(|| {
            let what = match self.inverted {
                true => "a value that cannot be inverted",
                false => "a value that is no such transform",
            };
            Error::format(FORMAT, &self.track.attribute.name, what)
        })
    }
}

/// Operations of a prim that are not the identity at all times.
#[derive(Debug, Default)]
pub(super) struct Ops {
    ops: Vec<Op>,
    /// True if the transforms of the parents do not apply.
    pub resets: bool,
}

impl Ops {
    /// Reads the list of operations of a prim, whose path is `path`.
    pub fn read<R: Read + Seek>(prim: &Prim, path: &str, values: &mut Values<R>) -> Result<Ops> {
        let mut found = Ops::default();
        let Some(order) = prim.attribute("xformOpOrder") else {
            return Ok(found);
        };
        let order = match Track::new(order).at(0.0, values)? {
            Some(Value::Words(order)) => order.clone(),
            None => return Ok(found),
            Some(other) => {
                let what = format!("xformOpOrder has {}, expected tokens", other.describe());
                return Err(Error::format(FORMAT, path, what));
            }
        };
        if order.len() > super::layer::ATTRIBUTES {
            let what = format!("xformOpOrder has {} operations", order.len());
            return Err(Error::format(FORMAT, path, what));
        }
        for token in &order {
            if token == "!resetXformStack!" {
                found = Ops {
                    resets: true,
                    ..Ops::default()
                };
                continue;
            }
            let (inverted, name) = match token.strip_prefix("!invert!") {
                Some(name) => (true, name),
                None => (false, token.as_str()),
            };
            let short = name.strip_prefix("xformOp:").unwrap_or_default();
            let short = short.split(':').next().unwrap_or_default();
            let Some(kind) = Kind::named(short) else {
                let what = format!("the transform {token:?} of {path}");
                return Err(Error::unsupported(FORMAT, what));
            };
            let Some(attribute) = prim.attribute(name) else {
                let what = format!("xformOpOrder names {name}, which is missing");
                return Err(Error::format(FORMAT, path, what));
            };
            if attribute.spline {
                let what = format!("{name} of {path} as a spline: write time samples");
                return Err(Error::unsupported(FORMAT, what));
            }
            let track = Track::new(attribute);
            let op = Op {
                kind,
                inverted,
                track,
            };
            let mut identity = true;
            op.track.each(values, |value| {
                if value != Value::Blocked {
                    let map = op.map(&value).map_err(|e| in_prim(path, e))?;
                    identity &= map == Affine::IDENTITY;
                }
                Ok(())
            })?;
            if !identity {
                found.ops.push(op);
            }
        }
        Ok(found)
    }

    pub fn is_identity(&self) -> bool {
        self.ops.is_empty()
    }

    /// Returns the values over time of all operations.
    pub fn tracks(&self) -> impl Iterator<Item = &Track> {
        self.ops.iter().map(|op| &op.track)
    }

    /// Returns the transform at a time.
    pub fn at<R: Read + Seek>(&mut self, time: f64, values: &mut Values<R>) -> Result<Affine> {
        let mut map = Affine::IDENTITY;
        for op in self.ops.iter_mut().rev() {
            let value = op.track.at(time, values)?.cloned();
            // An operation without a value does nothing.
            if let Some(value) = value {
                map = map.then(&op.map(&value)?);
            }
        }
        match map.is_finite() {
            true => Ok(map),
            false => Err(Error::format(FORMAT, "transform", "not finite")),
        }
    }
}

/// Adds the path of a prim to an error.
fn in_prim(path: &str, error: Error) -> Error {
    match error {
        Error::Format { place, what, .. } => {
            Error::format(FORMAT, path, format_args!("{place}: {what}"))
        }
        other => other,
    }
}
