//! Area lights whose objects are sheared.
//!
//! Cycles samples them by formulas for perpendicular edges, and the picture is what these give (`kernel/light/area.h`, Blender 4.2
//! to 5.3, where hits by chance, which use another shape, weigh next to nothing). Let `u` and `v` be the unit directions of the edges,
//! `C` the centre, `P` the origin of a segment, `f` the way that the light faces:
//!
//! * An ellipse is sampled by `C + a u + b v`, and each point counts by its cosine to `f` instead of that to the plane: what comes
//!   from there is brighter by that ratio, and by one over the sine between the edges.
//! * A rectangle is sampled by the solid angle of one with perpendicular edges: with `M = (u, v, u x v)`, directions
//!   `M w` for all `w` to a rectangle of the edges' lengths around `M^T (C - P)`. They are as dense as those of `w`, so
//!   that a segment weighs as much as the change of solid angle, `|det M^-1| / |M^-1 w|^3` for a unit direction `w`.
//!
//! Both shine on what lies before the plane through the centre that `f` is perpendicular to.

use glam::{Mat3, Vec3};

use crate::light::{Ball, Plane, Reach, Spread};

/// A sheared area light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sheared {
    pub center: Vec3,
    /// Unit.
    pub facing: Vec3,
    /// Rows that take the edge of a segment to where the light is perpendicular and -1/2 to 1/2.
    pub edge_rows: [Vec3; 3],
    /// Rows that take the way from its origin to the centre to the same coordinates.
    pub center_rows: [Vec3; 3],
    /// Lengths of the edges.
    pub lengths: [f32; 2],
    /// Determinant of the matrix that is `edge_rows` without the lengths.
    pub determinant: f32,
    pub is_ellipse: bool,
    pub spread: Option<Spread>,
}

impl Sheared {
    /// The light, and the factor for a floor on its size as of [`crate::PreparedLight::new`].
    pub fn new(
        center: Vec3,
        edges: [Vec3; 2],
        facing: Vec3,
        spread: f32,
        is_ellipse: bool,
        floor: f32,
    ) -> Result<(Self, f32), &'static str> {
        let facing = facing.try_normalize().ok_or("the way that it faces is not a direction")?;
        let across = edges[0].cross(edges[1]);
        let [u, v] = edges.map(Vec3::length);
        let is_flat = across.length() > 1e-4 * u * v;
        if !(is_flat && center.is_finite() && spread > 0.0) {
            return Err("its position or edges are not finite, or the edges are parallel or the spread is 0");
        }
        let lengths = [u, v].map(|length| length.max(2.0 * floor));
        let normal = (edges[0] / u).cross(edges[1] / v);
        let sine = normal.length();
        let third = if is_ellipse { normal / sine } else { normal };
        let matrix = Mat3::from_cols(edges[0] / u, edges[1] / v, third);
        let inverse = matrix.inverse();
        let rows = |matrix: Mat3| {
            let rows = matrix.transpose();
            [rows.x_axis / lengths[0], rows.y_axis / lengths[1], rows.z_axis]
        };
        let sheared = Self {
            center,
            facing,
            edge_rows: rows(inverse),
            center_rows: rows(if is_ellipse { inverse } else { matrix.transpose() }),
            lengths,
            determinant: inverse.determinant().abs(),
            is_ellipse,
            spread: Spread::new(spread),
        };
        let brighter = if is_ellipse { 1.0 / sine } else { 1.0 };
        Ok((sheared, brighter * (u / lengths[0]) * (v / lengths[1])))
    }

    /// Radiance that a segment collects from the light; 0 if it does not cross it.
    pub fn evaluate(&self, origin: Vec3, edge: Vec3) -> f32 {
        let to_center = self.center - origin;
        if to_center.dot(self.facing) >= 0.0 {
            return 0.0;
        }
        let [along, middle] = [(self.edge_rows, edge), (self.center_rows, to_center)]
            .map(|(rows, vector)| Vec3::from(rows.map(|row| row.dot(vector))));
        let share = middle.z / along.z;
        // The NaN of a segment within the plane is no hit, either.
        if !(share > 0.0 && share < 1.0) {
            return 0.0;
        }
        let [u, v] = [along.x * share - middle.x, along.y * share - middle.y];
        let inside = if self.is_ellipse { u * u + v * v <= 0.25 } else { u.abs() <= 0.5 && v.abs() <= 0.5 };
        if !inside {
            return 0.0;
        }
        let length = edge.length();
        let cos = -edge.dot(self.facing) / length;
        let weight = if self.is_ellipse {
            (cos * length / along.z.abs()).max(0.0)
        } else {
            let straight = Vec3::new(along.x * self.lengths[0], along.y * self.lengths[1], along.z);
            self.determinant * (length / straight.length()).powi(3)
        };
        weight * self.spread.map_or(1.0, |spread| if cos > 0.0 { spread.attenuation(cos) } else { 0.0 })
    }

    /// The parallelogram, or the ellipse in it, that its edges span.
    pub fn plane(&self) -> Plane {
        let normal = self.edge_rows[2].normalize();
        let [inverse_u, inverse_v, _] = self.edge_rows;
        let normal = if normal.dot(self.facing) < 0.0 { -normal } else { normal };
        Plane { center: self.center, normal, inverse_u, inverse_v, is_ellipse: self.is_ellipse }
    }

    /// True if the light seems to be where it is from everywhere.
    pub fn stays_in_place(&self) -> bool {
        self.is_ellipse || self.determinant < 1.000_001
    }

    pub fn reach(&self) -> Reach {
        let [u, v] = self.lengths;
        if self.stays_in_place() {
            // Edges that are not perpendicular make one diagonal longer, up to their sum.
            Reach::Ball(Ball { center: self.center, radius: 0.5 * (u + v) })
        } else {
            Reach::Everywhere
        }
    }
}
