use std::f32::consts::{PI, TAU};

use glam::Vec3;

/// Points are drawn on area lights that are larger by this in each direction, so that rounding at their rims is not at theirs.
const RIM: f32 = 1.01;

/// A rectangle or an ellipse around a centre, larger by [`RIM`] than the light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plate {
    /// Full edges.
    edges: [Vec3; 2],
    /// Their products with a point of the plane give its place on the plate, -1/2 to 1/2.
    across: [Vec3; 2],
    /// Unit, to the side that shines.
    pub normal: Vec3,
    area: f32,
    is_ellipse: bool,
}

impl Plate {
    /// One whose edges are not perpendicular.
    pub fn sheared(edge_u: Vec3, edge_v: Vec3, is_ellipse: bool) -> Self {
        let plate = Self::new(edge_u, edge_v, is_ellipse);
        let [u, v] = plate.edges;
        let (to_u, to_v) = (v.cross(plate.normal), plate.normal.cross(u));
        Self { across: [to_u / to_u.dot(u), to_v / to_v.dot(v)], ..plate }
    }

    pub fn new(edge_u: Vec3, edge_v: Vec3, is_ellipse: bool) -> Self {
        let edges = [edge_u * RIM, edge_v * RIM];
        let cross = edges[0].cross(edges[1]);
        let share = if is_ellipse { 0.25 * PI } else { 1.0 };
        Self {
            edges,
            across: edges.map(|edge| edge / edge.length_squared()),
            normal: cross.normalize_or(Vec3::Z),
            area: cross.length() * share,
            is_ellipse,
        }
    }

    /// Solid angle from afar, over that of a hemisphere.
    pub fn height(&self, to_center: Vec3) -> f32 {
        let cos = -self.normal.dot(to_center) / to_center.length();
        self.area * cos.abs() / (to_center.length_squared() * TAU)
    }

    /// A point, from the centre.
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let [x, y] = if self.is_ellipse {
            let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
            let radius = 0.5 * u[0].sqrt();
            [radius * cos_phi, radius * sin_phi]
        } else {
            u.map(|u| u - 0.5)
        };
        self.edges[0] * x + self.edges[1] * y
    }

    /// Density over solid angle of directions to [`Plate::sample`]: squared distance over area and cosine.
    pub fn density(&self, to_center: Vec3, direction: Vec3) -> f32 {
        let cos = -self.normal.dot(direction);
        let distance = -self.normal.dot(to_center) / cos;
        if !(distance > 0.0 && distance.is_finite()) {
            return 0.0;
        }
        let from_center = direction * distance - to_center;
        let [x, y] = self.across.map(|across| across.dot(from_center));
        let is_inside = if self.is_ellipse { x * x + y * y <= 0.25 } else { x.abs().max(y.abs()) <= 0.5 };
        if is_inside { distance * distance / (self.area * cos.abs()) } else { 0.0 }
    }
}
