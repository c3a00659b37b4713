//! The curves of a layer: which prims count, and what they have in common.

use super::FORMAT;
use super::affine::Ops;
use super::layer::{Layer, Prim, Value, WORD_BYTES};
use super::track::{Track, Values};
use crate::curve::Basis;
use crate::error::{Error, Result};
use crate::model::frames::LeftOut;
use std::io::{Read, Seek};

/// How the ends of curves are treated (`wrap`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wrap {
    Open,
    Closed,
    /// Open, with a point beyond each end, so that a spline reaches its first and last points.
    Pinned,
}

/// A prim `BasisCurves`.
#[derive(Debug)]
pub(super) struct Batch {
    /// Index of the prim.
    pub prim: usize,
    pub path: String,
    pub basis: Basis,
    pub wrap: Wrap,
    pub points: Track,
    pub counts: Track,
    pub widths: Option<Track>,
    /// Names in linkwatch's own files.
    pub names: Option<Vec<String>>,
}

/// Returns the prims with curves, and those that are left out by their purpose.
///
/// Errors: composition that may add or change curves; no curves; curves in forms that are not read.
pub(super) fn batches<R: Read + Seek>(
    layer: &Layer,
    values: &mut Values<R>,
) -> Result<(Vec<Batch>, Vec<LeftOut>)> {
    let flatten = |what: String| {
        let advice = "write all into one file with `usdcat --flatten IN --out OUT`, or in Python \
                      with Usd.Stage.Open(IN).Export(OUT)";
        Error::unsupported(FORMAT, format!("{what}: {advice}"))
    };
    if let Some(arc) = layer.arc {
        return Err(flatten(format!("a layer with {arc}")));
    }
    // For each prim: true if it is in the scene; its purpose; what moves its curves, in words.
    let mut places: Vec<(bool, Option<String>, Option<&str>)> =
        Vec::with_capacity(layer.prims.len());
    let mut batches = Vec::new();
    let mut left_out = Vec::new();
    for (k, prim) in layer.prims.iter().enumerate() {
        let (above, mut purpose, mut moved) = match prim.parent {
            Some(parent) => places[parent].clone(),
            None => (true, None, None),
        };
        let in_scene = above && prim.defined && !prim.inactive;
        if in_scene {
            if let Some(arc) = prim.arc {
                return Err(flatten(format!("{} with {arc}", layer.path(k))));
            }
            purpose = word(prim, "purpose", values)?.or(purpose);
            if prim.kind == "PointInstancer" {
                moved = Some("copied by a PointInstancer");
            } else if prim.attribute("primvars:skel:jointIndices").is_some() {
                moved = Some("moved by a skeleton");
            }
            let hidden = matches!(purpose.as_deref(), Some("proxy" | "guide"));
            match prim.kind.as_str() {
                "BasisCurves" | "NurbsCurves" | "HermiteCurves" if hidden => {
                    let kind = [
                        "prim with curves of purpose proxy or guide",
                        "prims with curves of purpose proxy or guide",
                    ];
                    LeftOut::add(&mut left_out, kind, || layer.path(k));
                }
                "BasisCurves" if let Some(moved) = moved => {
                    let what = format!("curves that are {moved}: {}", layer.path(k));
                    return Err(Error::unsupported(FORMAT, what));
                }
                "BasisCurves" => batches.push(batch(layer, k, values)?),
                kind @ ("NurbsCurves" | "HermiteCurves") => {
                    let what = format!(
                        "{} of type {kind}: BasisCurves are read; to exclude it, deactivate \
                         it (`active = false`)",
                        layer.path(k)
                    );
                    return Err(Error::unsupported(FORMAT, what));
                }
                "Points" | "Mesh" => {}
                _ if ["points", "curveVertexCounts"]
                    .iter()
                    .all(|a| prim.attribute(a).is_some()) =>
                {
                    let kind = [
                        "prim of an unknown type with curves",
                        "prims of unknown types with curves",
                    ];
                    LeftOut::add(&mut left_out, kind, || layer.path(k));
                }
                _ => {}
            }
        }
        places.push((in_scene, purpose, moved));
    }
    if batches.is_empty() {
        let what = match &left_out[..] {
            [] => "no curves: the file has no BasisCurves that are defined and active".into(),
            found => format!("no curves; {}", LeftOut::sentence(found)),
        };
        return Err(Error::format(FORMAT, "whole file", what));
    }
    check_basis(&batches)?;
    Ok((batches, left_out))
}

/// Fails if the curves do not have one basis. Converted curves would not be exactly the given ones.
fn check_basis(batches: &[Batch]) -> Result<()> {
    let first = &batches[0];
    match batches.iter().find(|b| b.basis != first.basis) {
        None => Ok(()),
        Some(other) => {
            let [a, b] = [first, other].map(|batch| {
                let closed = batch.wrap == Wrap::Closed;
                format!("{} has {} curves", batch.path, batch.basis.describe(closed))
            });
            let what = format!("{a}, {b}: all curves of a file must have one type and basis");
            Err(Error::unsupported(FORMAT, what))
        }
    }
}

/// Returns the token of an attribute that does not change over time.
fn word<R: Read + Seek>(prim: &Prim, name: &str, values: &mut Values<R>) -> Result<Option<String>> {
    let Some(attribute) = prim.attribute(name) else {
        return Ok(None);
    };
    let mut track = Track::new(attribute);
    if track.is_animated() {
        let what = format!("{name} of {} changes over time", prim.name);
        return Err(Error::unsupported(FORMAT, what));
    }
    match track.at(0.0, values)? {
        None => Ok(None),
        Some(Value::Words(words)) if words.len() == 1 => Ok(words.first().cloned()),
        Some(other) => {
            let what = format!("{name} has {}, expected a token", other.describe());
            Err(Error::format(FORMAT, &prim.name, what))
        }
    }
}

fn batch<R: Read + Seek>(layer: &Layer, k: usize, values: &mut Values<R>) -> Result<Batch> {
    let prim = &layer.prims[k];
    let path = layer.path(k);
    if path.len() > WORD_BYTES {
        let what = format!("{path}: a path of more than {WORD_BYTES} bytes");
        return Err(Error::unsupported(FORMAT, what));
    }
    let refuse = |what: String| Err(Error::unsupported(FORMAT, format!("{path}: {what}")));
    if prim.attribute("primvars:widths:indices").is_some() {
        return refuse("widths by indices".into());
    }
    let token = |name: &str, default: &str, values: &mut Values<R>| {
        let given = word(prim, name, values)?;
        Ok::<_, Error>(given.unwrap_or_else(|| default.into()))
    };
    let kind = token("type", "cubic", values)?;
    let basis = token("basis", "bezier", values)?;
    let basis = match (kind.as_str(), basis.as_str()) {
        ("linear", _) => Basis::Polyline,
        ("cubic", "bezier") => Basis::Bezier,
        ("cubic", "bspline") => Basis::BSpline,
        ("cubic", "catmullRom") => Basis::CatmullRom,
        ("cubic", other) => {
            return refuse(format!(
                "basis {other:?}; bezier, bspline and catmullRom are read"
            ));
        }
        (other, _) => return refuse(format!("type {other:?}; linear and cubic are read")),
    };
    let wrap = match token("wrap", "nonperiodic", values)?.as_str() {
        "nonperiodic" => Wrap::Open,
        "periodic" => Wrap::Closed,
        // Other curves reach their ends without more points.
        "pinned" if matches!(basis, Basis::Polyline | Basis::Bezier) => Wrap::Open,
        "pinned" => Wrap::Pinned,
        other => {
            let what = format!("wrap {other:?}; nonperiodic, periodic and pinned are read");
            return refuse(what);
        }
    };
    let track = |name: &str| {
        let missing = || Error::format(FORMAT, &path, format!("no {name}"));
        prim.attribute(name).map(Track::new).ok_or_else(missing)
    };
    let widths = prim.attribute("primvars:widths");
    let names = match prim.attribute(super::layer::NAMES_OF_CURVES) {
        None => None,
        Some(names) => match Track::new(names).at(0.0, values)? {
            Some(Value::Words(names)) => Some(names.clone()),
            _ => None,
        },
    };
    Ok(Batch {
        prim: k,
        basis,
        wrap,
        points: track("points")?,
        counts: track("curveVertexCounts")?,
        widths: widths.or(prim.attribute("widths")).map(Track::new),
        names,
        path,
    })
}

/// Reads the transforms of prims with curves, and of the prims above them. Others have none, and
/// neither have scopes and prims without a type.
pub(super) fn transforms<R: Read + Seek>(
    layer: &Layer,
    batches: &[Batch],
    values: &mut Values<R>,
) -> Result<Vec<Ops>> {
    let mut needed = vec![false; layer.prims.len()];
    for batch in batches {
        let mut next = Some(batch.prim);
        while let Some(k) = next.filter(|&k| !std::mem::replace(&mut needed[k], true)) {
            next = layer.prims[k].parent;
        }
    }
    let prims = layer.prims.iter().zip(needed).enumerate();
    prims
        .map(
            |(k, (prim, needed))| match needed && !matches!(&*prim.kind, "" | "Scope") {
                true => Ops::read(prim, &layer.path(k), values),
                false => Ok(Ops::default()),
            },
        )
        .collect()
}
