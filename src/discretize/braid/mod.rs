//! Braids: open curves between two rigid ends, joined to virtual closed loops (Qu & James 2021,
//! section 4.3.5 and appendix C).
//!
//! The curves `a[0] .. a[L-1]` of a braid, `L >= 4`, give `L` loops: `a[i]` from left to right, a
//! virtual connection within the right end volume, `a[i+1]` from right to left, and a virtual
//! connection within the left end volume (indices modulo `L`). The linking numbers of all pairs of
//! loops that share no curve, and of loops and closed curves, are the certificate. The loop of
//! `a[i]` has the index of `a[i]` in the frame, so certificates keep the number of curves.
//!
//! # Why a pull-through of two curves changes the certificate
//!
//! Each curve is part of two loops. If curves `i` and `j` are not cyclically adjacent, loops `i`
//! and `j` share no curve and their linking number changes; otherwise that of loops `i-1` and `j`.
//! This requires that no curve passes a virtual connection, and that these do not pass one another.
//! Every frame is checked for both:
//!
//! - A connection leaves its end point along a straight stub, runs within a layer of its own depth,
//!   and returns along another stub ([`routes`]). The end volume is a box around all layers, and a
//!   tube around each stub. No closed curve and no curve of a braid may enter the box, and only the
//!   curve that ends at a stub may enter its tube: a stub is part of the two loops that contain its
//!   curve, which are never compared with one another, so that curve may even cross it.
//! - An end volume moves as a rigid body. Its position follows from the end points of the curves
//!   ([`pose`]); if they moved against one another further than a tolerance, the end is not rigid.
//!   Within an end, connections of loops that are compared are separated by at least a quarter
//!   of the smallest distance of two stubs; an end point may be off by 0.15 of it at most.
//!   Positions of virtual vertices are rounded by some 1e-15 of the largest coordinate; that
//!   distance must be at least 1e-9 of it.
//! - Volumes of different ends must not overlap.
//!
//! A frame that breaks one of these conditions has no linking numbers of the loops of any braid.
//! The conditions are checked at each frame, not between frames.
//!
//! # Splines
//!
//! Curves of a spline basis become Bezier curves with the control points that the kernels use.
//! Virtual connections are cubics whose control points lie on a line, up to rounding.
//!
//! Cost: linear in the number of points, for each frame.

mod auto;
mod end;
mod loops;
mod pose;
mod routes;
mod volume;

pub use loops::BraidLoops;

use crate::curve::Point;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Braids of a scene: open curves between two rigid ends, which are verified as virtual closed
/// loops ([`SessionOptions::braids`](crate::SessionOptions::braids)).
///
/// ```
/// let text = r#"{"braids": [{"curves": [0, 1, 2, 3], "reversed": [3]}]}"#;
/// let braids = linkwatch::Braids::from_json(text)?;
/// assert_eq!(braids, linkwatch::Braids::from_json(&braids.to_json())?);
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Braids {
    /// Finds the braids in the first frame. Two open curves belong to the same braid if both pairs
    /// of their ends are closer than a quarter of the distance between the ends of either curve.
    /// Every open curve must belong to a braid of at least four.
    Auto,
    /// These braids.
    Given(Vec<Braid>),
}

/// One braid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Braid {
    /// Open curves, from 0, in the order in which they are joined: at least four.
    pub curves: Vec<u32>,
    /// Curves that start at the right end.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reversed: Vec<u32>,
    /// End at which the other curves start.
    #[serde(default, skip_serializing_if = "End::is_unknown")]
    pub left: End,
    /// The other end.
    #[serde(default, skip_serializing_if = "End::is_unknown")]
    pub right: End,
}

/// A rigid end of a braid. What is not given is taken from the first frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct End {
    /// Positions of the end points of all curves, in the order of [`Braid::curves`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<Point>,
    /// Direction, at these positions, in which the end volume lies. Not used if the points lie on
    /// a line: the volume is then always on the side that faces away from the other end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outward: Option<Point>,
}

impl End {
    fn is_unknown(&self) -> bool {
        *self == End::default()
    }
}

/// Content of a file of braids.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with a list `braids`")]
struct Content {
    braids: Vec<Braid>,
}

impl Braids {
    /// Reads braids from JSON: an object with a list `braids` of [`Braid`] objects.
    ///
    /// # Errors
    ///
    /// [`Error::Format`] if it is not valid, or lists no braid.
    pub fn from_json(text: &str) -> Result<Braids> {
        let content: Content = serde_json::from_str(text).map_err(|e| {
            let place = format!("line {}", e.line());
            Error::format("file of braids", place, e)
        })?;
        match content.braids.is_empty() {
            true => Err(Error::format("file of braids", "braids", "no braid")),
            false => Ok(Braids::Given(content.braids)),
        }
    }

    /// Reads braids from a JSON file.
    ///
    /// # Errors
    ///
    /// [`Error::File`] and those of [`Braids::from_json`].
    pub fn read(path: &Path) -> Result<Braids> {
        let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
        Braids::from_json(&text).map_err(|e| e.in_file(path))
    }

    /// Returns the braids as JSON. [`Braids::Auto`] has none yet.
    pub fn to_json(&self) -> String {
        let braids = match self {
            Braids::Auto => Vec::new(),
            Braids::Given(braids) => braids.clone(),
        };
        serde_json::to_string_pretty(&Content { braids }).expect("numbers and lists become JSON")
    }
}
