//! Position of a rigid body from points on it (Kabsch 1976), or of points on a line.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Position of a rigid end: `origin + rotation * local`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub rotation: Matrix3<f64>,
    pub origin: Vector3<f64>,
}

impl Pose {
    pub fn to_world(self, local: Vector3<f64>) -> Vector3<f64> {
        self.origin + self.rotation * local
    }

    pub fn to_local(self, world: Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(&(world - self.origin))
    }
}

/// Mean and principal axes of some points, and the standard deviation along each, largest first.
pub struct Principal {
    pub axes: [Vector3<f64>; 3],
    pub deviations: [f64; 3],
}

/// Returns the mean of some points.
pub fn mean(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().sum::<Vector3<f64>>() / points.len() as f64
}

/// Returns the principal axes of some points.
pub fn principal_axes(points: &[Vector3<f64>]) -> Principal {
    let center = mean(points);
    // Scaled, so that no square overflows or underflows.
    let sizes = points.iter().map(|p| (p - center).amax());
    let largest = sizes.fold(0.0, f64::max);
    let scale = if largest > 0.0 { largest } else { 1.0 };
    let squares = points.iter().map(|p| {
        let d = (p - center) / scale;
        d * d.transpose()
    });
    let covariance = squares.sum::<Matrix3<f64>>() / points.len() as f64;
    let eigen = SymmetricEigen::new(covariance);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    Principal {
        axes: order.map(|k| {
            let axis: Vector3<f64> = eigen.eigenvectors.column(k).into();
            // The sign of an eigenvector is arbitrary.
            axis * axis[axis.iamax()].signum()
        }),
        deviations: order.map(|k| scale * eigen.eigenvalues[k].max(0.0).sqrt()),
    }
}

/// Returns the pose in which the local points come closest to some points, in the least squares
/// sense. The local points have mean 0 and do not lie on a line.
pub fn fit(local: &[Vector3<f64>], points: &[Vector3<f64>]) -> Pose {
    let origin = mean(points);
    let scale = local.iter().map(Vector3::amax).fold(0.0, f64::max);
    let products = local.iter().zip(points);
    let h: Matrix3<f64> = products
        .map(|(q, p)| (p - origin) / scale * (q / scale).transpose())
        .sum();
    let svd = h.svd(true, true);
    let (u, v) = (svd.u.unwrap_or_default(), svd.v_t.unwrap_or_default());
    let mut turned = u;
    // Without this, the best orthogonal matrix may be a reflection.
    if (u * v).determinant() < 0.0 {
        let smallest = svd.singular_values.imin();
        turned.column_mut(smallest).neg_mut();
    }
    Pose {
        rotation: turned * v,
        origin,
    }
}

/// Returns the pose of points on a line, with local coordinates along the first axis. The third
/// axis is orthogonal to the line, and points away from `other` as far as possible. Returns `None`
/// if the line almost passes through `other`, or if the points have no direction.
pub fn fit_line(along: &[f64], points: &[Vector3<f64>], other: Vector3<f64>) -> Option<Pose> {
    /// Smallest sine of the angle between the line and the direction to the other end.
    const SINE: f64 = 0.05;
    let origin = mean(points);
    let products = along.iter().zip(points).map(|(x, p)| (p - origin) * *x);
    let sum: Vector3<f64> = products.sum();
    let x = sum.try_normalize(0.0)?;
    let away = (origin - other).try_normalize(0.0)?;
    let across = away - x * x.dot(&away);
    let z = across.try_normalize(SINE)?;
    Some(Pose {
        rotation: Matrix3::from_columns(&[x, z.cross(&x), z]),
        origin,
    })
}
