//! Periodic scenes: which images of which curves may meet, and their linking numbers.
//!
//! In a periodic scene, each curve stands for all its images: the curve translated by every lattice
//! vector of the [`Cell`](crate::Cell). A curve that closes in space has a linking number with
//! every image of every other such curve, and with its own images, nearly all of which are 0. The
//! entry `i, j, n` is that of curve `i` and of curve `j` translated by the lattice vector `n`; it
//! equals the entry `j, i, -n`, so `i <= j`, and `n` is positive in lexicographic order if `i = j`.
//!
//! # Which images may matter
//!
//! Two curves whose boxes do not overlap are not linked. [`ImagePairs`] has all pairs of a curve
//! and an image with overlapping boxes ([`boxes`]). They are verified like other pairs, in a set of
//! curves that holds the needed images ([`CurveSet::translate`](crate::CurveSet)). So incremental
//! verification and the search for pull-throughs work as they do without a cell.
//!
//! Curves that run through the cell have numbers with closed curves only ([`through`]).
//!
//! # Names of the images
//!
//! A curve may be given by the coordinates of any of its images. If curve `j` is given by the image
//! that is translated by a lattice vector `s`, then `s` is subtracted from the `n` of its entries.
//! The text of a certificate does not depend on such choices ([`canonical`]).

mod beside;
mod boxes;
mod jumps;
mod linking;
mod names;
mod nearest;
mod pairs;
mod through;
mod unwrap;

pub use beside::beside;
pub(crate) use boxes::{Bend, Boxer, FractionalBoxes};
pub(crate) use jumps::Jumps;
pub(crate) use linking::{Number, linking_numbers};
pub(crate) use names::{Entry, aligned, canonical, reduced_all};
pub(crate) use pairs::{
    ImagePair, ImagePairs, ImageState, QuietSlack, Searched, home_of, images_in, overlapping,
    too_far,
};
pub use through::period;
pub(crate) use through::period_in;
#[cfg(test)]
pub(crate) use through::reduced;
pub(crate) use through::{RingAndYarn, YarnPeriod, almost_yarns, is_multiple, period_of_pair};
pub use unwrap::Unwrap;
pub(crate) use unwrap::{Torn, check_whole, find_torn};
