//! Information of a simulator about a frame, besides its positions.

use crate::curve::{Cell, CurveChange, CurveLabels, Image};
use crate::error::{Error, Result};
use crate::verdict::LeftOut;
use std::sync::Arc;

/// Information about a frame that comes with its curves.
///
/// ```
/// use linkwatch::FrameInfo;
///
/// let info = FrameInfo::at(7, 0.7).in_cell("10,10,10".parse()?);
/// assert_eq!((info.seq, info.cuts), (7, 0));
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FrameInfo {
    /// Number of the frame.
    pub seq: u64,
    /// Simulation time, in the unit of the simulator; 0 if it is unknown.
    pub time: f64,
    /// Number of cuts that the simulator made before this frame. If it differs from that of the
    /// previous frame, this frame does not continue that one
    /// ([`Session::cut`](crate::Session::cut)).
    pub cuts: u32,
    /// Number of the frame whose linking numbers the simulator expects: its first one, or the last
    /// one that it accepted as a new baseline. If it differs from that of the previous frame, this
    /// frame is the new baseline.
    pub baseline: u64,
    /// Number of times that the simulator described its curves before this frame. If it differs
    /// from that of the previous frame, this frame has other curves: those of the same name
    /// continue, and are compared with the baseline. The linking numbers of curves that appear
    /// become part of the baseline. Pull-throughs are searched for among the curves that continue
    /// with the same number of points.
    pub layout: u32,
    /// Time step of the simulator, in its unit of time; 0 if it is unknown.
    pub time_step: f64,
    /// Periodic cell, if the scene repeats. The frames of a session have either all a cell or
    /// none. Another basis of the same lattice, as simulations take it that shear their cell, is
    /// replaced by that of the previous frame, in which all images have their names.
    pub cell: Option<Cell>,
    /// True if neither the file nor the caller says which curves are closed, so that the default of
    /// the format, all closed, applies
    /// ([`CurveSource::closed_by_default`](crate::CurveSource::closed_by_default)).
    pub closed_by_default: bool,
    /// Curves that were followed when they jumped by a lattice vector, with the sum of these
    /// vectors at the frame: a session that begins with it follows them from there. Only the frames
    /// of a session and of recordings have it.
    #[serde(skip)]
    pub translated: Vec<(u32, Image)>,
    /// Names and radii of the curves.
    pub labels: Arc<CurveLabels>,
    /// Elements that may be curves of the frame and are not among its curves, because a reader did
    /// not read them. The frame counts as verified in part.
    #[serde(skip)]
    pub left_out: Vec<LeftOut>,
}

impl FrameInfo {
    /// Returns the information about a frame at this time, in the unit of the simulator.
    pub fn at(seq: u64, time: f64) -> FrameInfo {
        FrameInfo {
            seq,
            time,
            ..FrameInfo::default()
        }
    }

    /// Returns this information with a periodic cell.
    pub fn in_cell(mut self, cell: Cell) -> FrameInfo {
        self.cell = Some(cell);
        self
    }

    /// Returns this information with names and radii of the curves. Use another number of the
    /// layout whenever they change.
    pub fn with_labels(mut self, layout: u32, labels: impl Into<Arc<CurveLabels>>) -> FrameInfo {
        (self.layout, self.labels) = (layout, labels.into());
        self
    }

    /// Compares this frame with the last verified frame of its session. Returns the change of the
    /// curves if it has other curves.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if the curves changed, but have no names; [`Error::Format`] if
    /// names or radii changed, but not the number of the layout. Curves would then be compared
    /// with others under their name.
    pub(crate) fn change_since(&self, last: &FrameInfo) -> Result<Option<CurveChange>> {
        if last.layout != self.layout {
            return CurveChange::by_name(&last.labels, &self.labels).map(Some);
        }
        if Arc::ptr_eq(&last.labels, &self.labels) {
            return Ok(None);
        }
        let (before, now) = (&*last.labels, &*self.labels);
        let place = match (before.names == now.names, before.radii == now.radii) {
            (true, true) => return Ok(None),
            (false, _) => "names of the curves",
            (true, false) => "radii of the curves",
        };
        let what = format!(
            "they changed, but not the layout number {}: add 1 to it with each description of the \
             curves",
            self.layout
        );
        Err(Error::format("frame", place, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejects_other_names_and_radii_with_the_same_layout() {
        let info = |layout, names: [&str; 2], radius: f32| FrameInfo {
            layout,
            labels: Arc::new(CurveLabels::named(names).with_radii([radius; 2])),
            ..FrameInfo::default()
        };
        let last = info(7, ["a", "b"], 1.0);
        assert!(last.change_since(&last).unwrap().is_none());
        let fails = |now: FrameInfo| now.change_since(&last).unwrap_err().to_string();
        let names = fails(info(7, ["b", "a"], 1.0));
        assert!(
            names.starts_with("not a valid frame (names of the curves)"),
            "{names}"
        );
        assert!(names.contains("layout number 7"), "{names}");
        let radii = fails(info(7, ["a", "b"], 2.0));
        assert!(
            radii.starts_with("not a valid frame (radii of the curves)"),
            "{radii}"
        );
        let change = info(8, ["b", "c"], 2.0)
            .change_since(&last)
            .unwrap()
            .unwrap();
        assert_eq!(
            (&change.appeared[..], &change.gone[..]),
            (&["c".into()][..], &["a".into()][..])
        );
    }
}
