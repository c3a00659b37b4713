//! Polygons in single precision: x y z of each point.

/// A square with edges of length 2 around `center`, in the plane of two axes.
pub fn square(center: [f32; 3], axes: [usize; 2]) -> Vec<f32> {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let place = |corner: [f32; 2]| {
        let mut p = center;
        p[axes[0]] += corner[0];
        p[axes[1]] += corner[1];
        p
    };
    corners.into_iter().flat_map(place).collect()
}

/// Two linked squares, the second one displaced by `shift`: apart from 2 on.
pub fn squares(shift: f32) -> Vec<f32> {
    let first = square([0.0; 3], [0, 1]);
    [first, square([1.0 + shift, 0.0, 0.0], [0, 2])].concat()
}
