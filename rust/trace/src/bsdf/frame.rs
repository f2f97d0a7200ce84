//! Orthonormal frames and cosine-weighted directions.

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::Vec3;

/// Right-handed orthonormal basis whose z is a surface normal.
#[derive(Clone, Copy, Debug)]
pub struct ShadingFrame {
    x: Vec3,
    y: Vec3,
    z: Vec3,
}

impl ShadingFrame {
    /// Any frame about the unit `normal`.
    pub fn from_normal(normal: Vec3) -> Self {
        let (x, y) = normal.any_orthonormal_pair();
        Self { x, y, z: normal }
    }

    /// The frame about the unit `normal` whose x points along `tangent` as far as it can; any frame if the two are
    /// parallel.
    pub fn from_tangent(normal: Vec3, tangent: Vec3) -> Self {
        match normal.cross(tangent).try_normalize() {
            Some(y) => Self { x: y.cross(normal), y, z: normal },
            None => Self::from_normal(normal),
        }
    }

    /// The unit normal that it is about.
    pub fn normal(&self) -> Vec3 {
        self.z
    }

    /// A vector's coordinates in the frame.
    pub fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }

    /// The vector with coordinates `v` in the frame.
    pub fn world(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}

/// A point of the unit disk, uniform over its area.
pub fn sample_disk(u: [f32; 2]) -> (f32, f32) {
    let radius = u[0].sqrt();
    let (sin, cos) = (TAU * u[1]).sin_cos();
    (radius * cos, radius * sin)
}

/// A direction about `normal` with density [`cosine_pdf`].
pub fn sample_cosine(normal: Vec3, u: [f32; 2]) -> Vec3 {
    let (x, y) = sample_disk(u);
    ShadingFrame::from_normal(normal).world(Vec3::new(x, y, (1.0 - u[0]).max(0.0).sqrt()))
}

/// Density of [`sample_cosine`] for a direction at `cos` to the normal.
pub fn cosine_pdf(cos: f32) -> f32 {
    cos.max(0.0) * FRAC_1_PI
}
