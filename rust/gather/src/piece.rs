//! Segments behind transparent surfaces and null collisions: pieces of a ray that began before.
//!
//! Lights are crossed by the ray, not by its pieces: where it began decides whether it comes from inside of a sphere or
//! from the front of an area, and how a facing disk is turned. So a piece adds what the ray collects up to the piece's
//! end, less what it collects up to the piece's start. All pieces of a ray then add what the whole of it collects.

use glam::Vec3;

/// A piece of a ray, seen from where the ray began. The ray is taken to come straight along the piece, since first tests
/// look at pieces, and ends of pieces are rounded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayPiece {
    pub origin: Vec3,
    /// To the start of the piece; 0 if the ray begins there.
    pub to_start: Vec3,
    /// To its end.
    pub to_end: Vec3,
}

impl RayPiece {
    /// The piece that goes from `start` along `edge`, which is longer than 0. An escaped one is as long as
    /// [`crate::light::FAR`].
    pub fn new(ray_origin: Vec3, start: Vec3, edge: Vec3) -> Self {
        let to_start = edge * (ray_origin.distance(start) / edge.length());
        Self { origin: start - to_start, to_start, to_end: to_start + edge }
    }
}
