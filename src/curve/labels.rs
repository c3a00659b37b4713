//! Names and radii of curves, and changes of the curves between two frames.

#[cfg(feature = "verify")]
use super::CurveSet;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};

/// Maximum number of bytes of a name.
const MAX_NAME_BYTES: usize = 255;

/// Names and radii of the curves of a frame. Both are optional.
///
/// A simulator that adds or removes curves names them: curves of different frames are the same
/// curve if they have the same name. A name belongs to one curve for the whole session; do not use
/// it for another curve later.
///
/// ```
/// use linkwatch::CurveLabels;
///
/// let labels = CurveLabels::named(["sleeve/0", "sleeve/1"]).with_radii([0.8e-3, 0.8e-3]);
/// assert!(labels.check(2).is_ok());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct CurveLabels {
    /// Name of each curve; empty if the curves have no names. Names differ from one another, and
    /// have 1 to 255 bytes of UTF-8 without control characters.
    pub names: Vec<String>,
    /// Radius of each curve, half the diameter of a yarn or wire, in the units of the simulation;
    /// empty if it is unknown. At least 0.
    pub radii: Vec<f32>,
}

impl CurveLabels {
    /// Creates labels with a name for each curve.
    pub fn named<S: Into<String>>(names: impl IntoIterator<Item = S>) -> CurveLabels {
        CurveLabels {
            names: names.into_iter().map(Into::into).collect(),
            radii: Vec::new(),
        }
    }

    /// Returns these labels with a radius for each curve.
    pub fn with_radii(mut self, radii: impl IntoIterator<Item = f32>) -> CurveLabels {
        self.radii = radii.into_iter().collect();
        self
    }

    /// Returns true if the curves have neither names nor radii.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty() && self.radii.is_empty()
    }

    /// Checks labels of this number of curves.
    ///
    /// # Errors
    ///
    /// [`Error::Count`] if there is another number of names or radii; [`Error::Format`] if
    /// a name or a radius is invalid, or two curves have the same name.
    pub fn check(&self, curves: usize) -> Result<()> {
        let count = |what, n: usize| match n == 0 || n == curves {
            true => Ok(()),
            false => Err(Error::count(what, curves, n)),
        };
        count("names of curves", self.names.len())?;
        count("radii of curves", self.radii.len())?;
        let bad = |i: usize, what: String| Err(Error::format("curve", format_args!("{i}"), what));
        let mut seen = HashMap::with_capacity(self.names.len());
        for (i, name) in self.names.iter().enumerate() {
            if name.is_empty() || name.len() > MAX_NAME_BYTES || name.contains(char::is_control) {
                let what = "expected 1 to 255 bytes without control characters";
                return bad(i, format!("name {name:?}, {what}"));
            }
            if let Some(first) = seen.insert(name, i) {
                return bad(i, format!("name {name:?}, which is that of curve {first}"));
            }
        }
        let invalid = |r: &f32| !(*r >= 0.0 && r.is_finite());
        match self.radii.iter().position(invalid) {
            Some(i) => {
                let what = "expected at least 0 and finite in single precision";
                bad(i, format!("radius {}, {what}", self.radii[i]))
            }
            None => Ok(()),
        }
    }
}

/// Returns the words for a curve: its index, and its name if it has one.
pub(crate) fn words_of_curve(i: u32, names: &[String]) -> String {
    match names.get(i as usize) {
        Some(name) => format!("{i} ({name})"),
        None => i.to_string(),
    }
}

/// Change of the curves between two frames: some appeared, some are gone, others may have another
/// index.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CurveChange {
    /// Number of curves before.
    pub before: usize,
    /// Index of each curve before; `None` if it appeared.
    pub origins: Vec<Option<u32>>,
    /// Same as `origins`, but `None` also for curves that were open and are closed: no earlier
    /// frame has their linking numbers.
    pub expected: Vec<Option<u32>>,
    /// Names of the curves that appeared, in the order of the frame.
    pub appeared: Vec<String>,
    /// Names of the curves that disappeared, in the order of the previous frame.
    pub gone: Vec<String>,
    /// Names of the curves that were closed before, and are open.
    pub opened: Vec<String>,
    /// Names of the curves that were open before, and are closed.
    pub closed: Vec<String>,
    /// Names of the other curves with another number of points than before.
    pub resized: Vec<String>,
    /// Names of curves that appeared, and had existed before they disappeared.
    pub returned: Vec<String>,
}

impl CurveChange {
    /// Compares curves by their names.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if either curves have no names.
    pub fn by_name(before: &CurveLabels, after: &CurveLabels) -> Result<CurveChange> {
        if before.names.is_empty() || after.names.is_empty() {
            return Err(Error::Usage(
                "the curves were described again, but have no names to compare them by: give each \
                 curve a name from the first frame on"
                    .into(),
            ));
        }
        let indices = before.names.iter().zip(0_u32..);
        let indices: HashMap<&String, u32> = indices.collect();
        let kept: HashSet<&String> = after.names.iter().collect();
        let index = |name| indices.get(name).copied();
        let is_new = |name: &&String| !indices.contains_key(*name);
        let is_gone = |name: &&String| !kept.contains(*name);
        let origins: Vec<Option<u32>> = after.names.iter().map(index).collect();
        Ok(CurveChange {
            before: before.names.len(),
            expected: origins.clone(),
            origins,
            appeared: after.names.iter().filter(is_new).cloned().collect(),
            gone: before.names.iter().filter(is_gone).cloned().collect(),
            ..CurveChange::default()
        })
    }

    /// Notes which of the curves, with these names, were closed before and are open, the other way
    /// round, or have another number of points. The last ones count if there are open curves, which
    /// have no linking numbers, or if `all` passages are searched for.
    #[cfg(feature = "verify")]
    pub fn note_kinds(&mut self, before: &CurveSet, now: &CurveSet, names: &[String], all: bool) {
        let is_searched = all || before.open_curves() + now.open_curves() > 0;
        for (i, origin) in self.origins.iter().enumerate() {
            let Some(k) = *origin else {
                continue;
            };
            let (before, now) = (before.curve(k as usize), now.curve(i));
            match (before.closed, now.closed) {
                (true, false) => self.opened.push(names[i].clone()),
                (false, true) => {
                    self.closed.push(names[i].clone());
                    self.expected[i] = None;
                }
                _ if before.points != now.points => {
                    self.resized.extend(is_searched.then(|| names[i].clone()));
                }
                _ => {}
            }
        }
    }

    /// Returns a text about what is not compared with earlier frames.
    #[cfg(feature = "verify")]
    pub fn words_of_uncompared(&self) -> impl Iterator<Item = String> {
        let opened = words_of_first(&self.opened).map(|curves| {
            format!("the linking numbers of curve {curves}: closed in the previous frame, and open")
        });
        let returned = words_of_first(&self.returned)
            .map(|curves| format!("what became of curve {curves} while it was gone"));
        let replaced = self.before > 0 && self.origins.iter().all(Option::is_none);
        let replaced = replaced.then(|| "all linking numbers: no curve kept its name".to_owned());
        opened.into_iter().chain(returned).chain(replaced)
    }

    /// Returns a text that names the curves whose pull-throughs are not searched for, because they
    /// were open and are closed now, or have another number of points. `None` if there are none.
    #[cfg(feature = "verify")]
    pub fn words_of_unsearched(&self) -> Option<String> {
        let closed = words_of_first(&self.closed)
            .map(|curves| format!("{curves}: open in the previous frame, and closed"));
        let resized = words_of_first(&self.resized)
            .map(|curves| format!("{curves}: another number of points than in the previous frame"));
        let words: Vec<String> = closed.into_iter().chain(resized).collect();
        (!words.is_empty()).then(|| format!("pull-throughs of curve {}", words.join("; of curve ")))
    }

    /// Returns a text that names the curves that were open and are closed now, which have no
    /// earlier linking numbers. `None` if there are none.
    #[cfg(feature = "verify")]
    pub fn words_of_closed(&self) -> Option<String> {
        let curves = words_of_first(&self.closed)?;
        Some(format!(
            "the linking numbers of curve {curves}: open in the previous frame, and closed"
        ))
    }

    /// Returns true if the same curves are in the same order.
    pub fn is_identity(&self) -> bool {
        let same = |(i, origin): (u32, &Option<u32>)| *origin == Some(i);
        self.before == self.origins.len() && (0..).zip(&self.origins).all(same)
    }
}

/// Returns the first name and how many others there are. `None` if there are no names.
#[cfg(feature = "verify")]
fn words_of_first(names: &[String]) -> Option<String> {
    let first = names.first()?;
    Some(match names.len() - 1 {
        0 => first.clone(),
        n => format!("{first} and {n} more"),
    })
}

/// Returns a text that names the curves that appeared and disappeared: "curves appeared: a, b;
/// gone: c". `None` if there are none.
pub(crate) fn words_of_change(appeared: &[String], gone: &[String]) -> Option<String> {
    /// Maximum number of names of each kind; the rest is counted.
    const NAMED: usize = 8;
    let list = |names: &[String]| match names.len().saturating_sub(NAMED) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..NAMED].join(", ")),
    };
    let both = [("appeared", appeared), ("gone", gone)].into_iter();
    let both = both.filter(|(_, names)| !names.is_empty());
    let words = both.map(|(what, names)| format!("{what}: {}", list(names)));
    let words: Vec<String> = words.collect();
    (!words.is_empty()).then(|| format!("curves {}", words.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "verify")]
    #[test]
    fn a_change_lists_curves_by_name() {
        let before = CurveLabels::named(["a", "b", "c"]);
        let after = CurveLabels::named(["c", "d", "a"]);
        let change = CurveChange::by_name(&before, &after).unwrap();
        assert_eq!(change.origins, [Some(2), None, Some(0)]);
        let words = words_of_change(&change.appeared, &change.gone).unwrap();
        assert_eq!(words, "curves appeared: d; gone: b");
        let same = CurveChange::by_name(&before, &before).unwrap();
        assert_eq!(words_of_change(&same.appeared, &same.gone), None);
        assert!(CurveChange::by_name(&before, &CurveLabels::default()).is_err());
    }

    #[test]
    fn rejects_labels_that_do_not_name_every_curve_once() {
        let fails = |labels: CurveLabels| labels.check(2).unwrap_err().to_string();
        assert_eq!(
            fails(CurveLabels::named(["a"])),
            "names of curves: 2 promised, 1 available"
        );
        assert_eq!(
            fails(CurveLabels::named(["a", "a"])),
            "not a valid curve (1): name \"a\", which is that of curve 0"
        );
        fails(CurveLabels::named(["a", ""]));
        fails(CurveLabels::named(["a", "b\n"]));
        fails(CurveLabels::named(["a".to_owned(), "b".repeat(256)]));
        for radius in [-1.0, f32::NAN, f32::INFINITY] {
            fails(CurveLabels::default().with_radii([0.0, radius]));
        }
        assert!(CurveLabels::default().check(2).is_ok());
    }
}
