//! Points on tori around one circle.

use crate::curve::Point;

/// Returns the point on the torus of this tube radius around the unit circle of the xy plane, at a
/// toroidal angle (along the circle) and a poloidal one (around it), in radians.
///
/// The linking number of a curve inside of a torus and one outside is the product of two numbers:
/// the toroidal turns of the inner one, which is homologous to that multiple of the core, and the
/// poloidal turns of the outer one. The direction of the poloidal angle makes two positive numbers
/// count +1.
pub(super) fn on_torus(tube: f64, toroidal: f64, poloidal: f64) -> Point {
    let ((s, c), (sp, cp)) = (toroidal.sin_cos(), poloidal.sin_cos());
    let r = 1.0 + tube * cp;
    [r * c, r * s, -tube * sp]
}
