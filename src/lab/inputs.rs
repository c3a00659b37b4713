//! Inputs of the rows of the published table: the published model, or others of its size.
//!
//! The published models are files that the user has, or scenes with the published parameters. The
//! garments were not published. In their place stand generated tubes, and models that
//! `examples/table1.sh` simulates and writes to a folder; each says what differs.

use super::published::Source::{self, File, Scene};

/// Input of a row.
#[derive(Clone, Copy, Debug)]
pub struct Input {
    /// Source of the model in this project.
    pub source: Source,
    /// Difference from the published model; `None` if this is it.
    pub differs: Option<&'static str>,
}

/// Returns the published model.
const fn own(source: Source) -> Input {
    Input {
        source,
        differs: None,
    }
}

/// Returns another model of about the same size.
const fn other(source: Source, differs: &'static str) -> Input {
    Input {
        source,
        differs: Some(differs),
    }
}

const TUBE: &str = "a generated knitted tube, no garment";
const GARMENT: &str = "the garment of examples/yarn, a body with two sleeves, before its fall";

pub(super) const ALIEN_INITIAL: &[Input] = &[
    own(File("aliensweaterinit.bcc")),
    other(File("garment-73x106-initial.bcc"), GARMENT),
    other(Scene("knit:rows=146,stitches=119,segments=138992"), TUBE),
];
pub(super) const ALIEN_FINAL: &[Input] = &[
    own(File("aliensweaterfinal.bcc")),
    other(
        File("garment-73x106-final.bcc"),
        "the garment of examples/yarn, a body with two sleeves, after a second of its fall",
    ),
];
pub(super) const SHEEP: &[Input] = &[
    own(File("sheepsweater.bcc")),
    other(File("garment-274x148.bcc"), GARMENT),
    other(Scene("knit:rows=549,stitches=166,segments=729072"), TUBE),
];
pub(super) const SWEATER: &[Input] = &[
    own(File("sweater.bcc")),
    other(File("garment-126x120.bcc"), GARMENT),
    other(Scene("knit:rows=253,stitches=134,segments=271216"), TUBE),
];
pub(super) const GLOVE: &[Input] = &[own(File("glove.bcc"))];
pub(super) const KNIT_INITIAL: &[Input] = &[
    own(File("knittubeinit.bcc")),
    other(
        File("tube-39x39-initial.bcc"),
        "the tube of examples/yarn, polylines",
    ),
    other(
        Scene("knit:rows=39,stitches=39,segments=18252"),
        "a generated tube, not relaxed",
    ),
];
pub(super) const KNIT_FINAL: &[Input] = &[
    own(File("knittubebroken.bcc")),
    other(
        File("tube-39x39-final.bcc"),
        "the tube of examples/yarn, wrung until it breaks, polylines",
    ),
];
const SPACING: &str = "the paper does not give the spacing of the rings";
pub(super) const CHAINMAIL_INITIAL: &[Input] = &[other(Scene("chainmail"), SPACING)];
pub(super) const CHAINMAIL_FINAL: &[Input] = &[
    other(
        Scene("chainmail:crumple=1"),
        "a generated crumpled sheet, not packed into a box",
    ),
    other(
        File("packed-69.bcc"),
        "examples/chainmail --pack, frame 60 of 120: a square sheet of 14,145 rings of 12 segments",
    ),
];
pub(super) const CHEVRON: &[Input] = &[
    own(File("chevron.bcc")),
    other(
        File("tube-32x31.bcc"),
        "the tube of examples/yarn, plain stitches",
    ),
    other(
        Scene("knit:rows=32,stitches=46,segments=11776"),
        "a generated tube, plain stitches",
    ),
];
pub(super) const BANDS: &[Input] = &[
    other(
        Scene("rubber_bands"),
        "a generated pile; the paper does not give the shapes",
    ),
    other(
        File("bands-final.bcc"),
        "examples/bands after its fall: 24 segments a band, not 50",
    ),
];
pub(super) const RIBBON: &[Input] = &[own(Scene("ribbon"))];
pub(super) const RIBBON_TWISTED: &[Input] = &[own(Scene("ribbon:lambda=1000"))];
pub(super) const LONG_RIBBON: &[Input] = &[own(Scene("ribbon:segments=2e7"))];
pub(super) const LONG_RIBBON_TWISTED: &[Input] = &[own(Scene("ribbon:segments=2e7,lambda=1000"))];
pub(super) const SQUARE: &[Input] = &[own(Scene("square_link"))];
pub(super) const LARGE_SQUARE: &[Input] = &[own(Scene("square_link:loops=5000,segments=4e6"))];
pub(super) const TORUS: &[Input] = &[own(Scene("torus_link"))];
pub(super) const TORUS_ZERO: &[Input] = &[other(
    Scene("torus_zero:segments=4e7,periods=1000"),
    "the paper does not give the number of periods",
)];
pub(super) const WOUNDBALL: &[Input] = &[own(Scene("woundball"))];
pub(super) const WOUNDBALL_DENSE: &[Input] =
    &[own(Scene("woundball:segments=2e6,crossings=10000"))];
