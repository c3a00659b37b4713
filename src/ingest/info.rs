//! What a simulator tells about a frame, beside its positions.

use crate::curve::{Cell, CurveChange, CurveLabels};
use crate::error::{Error, Result};
use std::sync::Arc;

/// What a simulator tells about a frame, beside its number, its time and its curves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameInfo {
    /// Number of cuts that the simulator made before this frame. If it differs from that of the
    /// previous frame, this frame does not continue that one
    /// ([`Verifier::cut`](crate::Verifier::cut)).
    pub cuts: u32,
    /// Number of the frame whose linking numbers the simulator expects: its first one, or the last
    /// one that it accepted as a new baseline. If it differs from that of the previous frame, this
    /// frame is the new baseline.
    pub baseline: u64,
    /// Number of times that the simulator described its curves before this frame. If it differs
    /// from that of the previous frame, this frame has other curves
    /// ([`Verifier::change_curves`](crate::Verifier::change_curves)).
    pub layout: u32,
    /// Time step of the simulator in seconds; 0 if it is unknown.
    pub time_step: f64,
    /// Periodic cell, if the scene repeats ([`Verifier::set_cell`](crate::Verifier::set_cell)).
    pub cell: Option<Cell>,
    /// True if nothing says which curves are closed, and the format closes them all
    /// ([`CurveSource::closed_by_default`](crate::CurveSource::closed_by_default)).
    pub closed_by_default: bool,
    /// Names and radii of the curves.
    pub labels: Arc<CurveLabels>,
}

impl FrameInfo {
    /// Compares this frame with the last verified frame of its session. Returns the change of the
    /// curves if it has other curves; pass it to
    /// [`Verifier::change_curves`](crate::Verifier::change_curves).
    ///
    /// Errors: [`Error::Usage`] if the curves changed, but have no names; [`Error::Format`] if
    /// names or radii changed, but not the number of the layout. Curves would then be compared
    /// with others under their name.
    pub fn change_since(&self, last: &FrameInfo) -> Result<Option<CurveChange>> {
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
            (change.appeared(), change.gone()),
            (&["c".into()][..], &["a".into()][..])
        );
    }
}
