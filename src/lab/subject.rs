//! Curves to measure, with the exact results that every run must reproduce.

use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::engine::Certifier;
use crate::error::Result;
use crate::scenes::Scene;
use crate::verdict::Stats;

/// Curves to measure, with their exact certificate.
#[derive(Clone, Debug)]
pub struct Subject {
    /// Name of the model or description of the scene.
    pub name: String,
    /// The curves.
    pub curves: CurveSet,
    /// Certificate of the curves, by counting crossings.
    pub exact: Certificate,
    /// Work counters of that certificate.
    pub stats: Stats,
    /// Number of segment pairs in the potential links, of the polylines: the work of sums without
    /// trees.
    pub segment_pairs: u64,
    /// True if the certificate is the known one of a scene or a model, or none is known.
    pub as_expected: bool,
}

impl Subject {
    /// Certifies curves as a reference.
    ///
    /// Errors: those of the discretization of splines.
    pub fn new(name: &str, curves: CurveSet) -> Result<Subject> {
        let mut certifier = Certifier::default();
        let (exact, stats) = certifier.certify(&curves);
        let exact = exact.clone();
        let segment_pairs = match curves.basis().is_polyline() {
            true => certifier.segment_pairs(&curves),
            false => certifier.segment_pairs(&homotopic_polylines(&curves)?.curves),
        };
        Ok(Subject {
            name: name.into(),
            curves,
            exact,
            stats,
            segment_pairs,
            as_expected: true,
        })
    }

    /// Builds a scene from its description and compares its certificate with the one that follows
    /// from its construction.
    ///
    /// Errors: the text does not describe a scene that can be built.
    pub fn scene(text: &str) -> Result<Subject> {
        let scene = text.parse::<Scene>()?.build()?;
        Ok(Subject::new(text, scene.curves)?.expecting(&scene.certificate))
    }

    /// Compares the certificate with a known one.
    pub fn expecting(mut self, known: &Certificate) -> Subject {
        self.as_expected = self.exact == *known;
        self
    }
}
