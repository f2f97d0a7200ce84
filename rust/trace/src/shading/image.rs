//! Image textures: the point on the image that a projection looks up, and the tile that it is in.

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::{Vec2, Vec3, Vec4};
use relume_scene::{Extension, ImageProjection, Interpolation, Tile};

use super::coordinates::generated_at;
use super::evaluate::ShadingContext;
use super::texture::equirectangular;

/// Tiles in a row of an image.
const TILES_A_ROW: i32 = 10;
/// Number of the first tile.
const FIRST_TILE: i32 = 1001;

/// An image as a node shows it.
pub struct Image<'a> {
    /// The image; what is shown outside of tiles if there are any.
    pub texture: usize,
    /// Tiles, none for an image of one.
    pub tiles: &'a [Tile],
    /// Filter of texels.
    pub interpolation: Interpolation,
    /// Extension of each tile.
    pub extension: Extension,
    /// True if colours are to be divided by alpha.
    pub straight: bool,
}

impl Image<'_> {
    /// Scene-linear colour and alpha at texture coordinates.
    pub fn projected(&self, context: &ShadingContext, projection: ImageProjection, at: Vec3) -> Vec4 {
        match projection {
            ImageProjection::Flat => self.at(context, at.truncate()),
            ImageProjection::Sphere => self.at(context, on_sphere(at * 2.0 - 1.0)),
            ImageProjection::Tube => self.at(context, on_tube(at * 2.0 - 1.0)),
            ImageProjection::Equirectangular => {
                self.at(context, equirectangular(at.normalize_or_zero()).into())
            }
            ImageProjection::MirrorBall => self.at(context, on_mirror_ball(at.normalize_or_zero())),
            ImageProjection::Layers { count, of_object } => {
                let at = if of_object { generated_at(context, at) } else { at };
                let image = &context.scene.textures[self.texture];
                context.prepared.textures[self.texture].sample_layers(
                    image,
                    at.to_array(),
                    count,
                    self.interpolation,
                    self.extension,
                )
            }
            ImageProjection::Box { blend } => {
                let normal = context.prepared.object_normal(
                    context.point.instance,
                    context.point.time,
                    context.point.shading_normal,
                );
                let sides = [
                    Vec2::new(mirrored(at.y, normal.x < 0.0), at.z),
                    Vec2::new(mirrored(at.x, normal.y > 0.0), at.z),
                    Vec2::new(mirrored(at.y, normal.z > 0.0), at.x),
                ];
                let weights = side_weights(normal.abs(), blend).to_array();
                let shown = sides.into_iter().zip(weights).filter(|(_, weight)| *weight > 0.0);
                shown.map(|(uv, weight)| self.at(context, uv) * weight).sum()
            }
        }
    }

    /// Scene-linear colour and alpha at a point of the image.
    fn at(&self, context: &ShadingContext, uv: Vec2) -> Vec4 {
        let (texture, uv) = if self.tiles.is_empty() { (self.texture, uv) } else { self.tile(uv) };
        context.prepared.textures[texture].sample(
            &context.scene.textures[texture],
            uv.to_array(),
            self.interpolation,
            self.extension,
            self.straight,
        )
    }

    /// Image of the tile that a point is in, and the point in it. Below 0 the first row and column go on for one tile, as
    /// Cycles cuts off decimals.
    fn tile(&self, uv: Vec2) -> (usize, Vec2) {
        let (column, row) = (uv.x as i32, uv.y as i32);
        if !(0..TILES_A_ROW).contains(&column) || row < 0 {
            return (self.texture, uv);
        }
        let number = row.saturating_mul(TILES_A_ROW).saturating_add(column + FIRST_TILE);
        let found = self.tiles.iter().find(|tile| u32::try_from(number) == Ok(tile.number));
        found.map_or((self.texture, uv), |tile| (tile.texture, uv - Vec2::new(column as f32, row as f32)))
    }
}

fn mirrored(u: f32, is_mirrored: bool) -> f32 {
    if is_mirrored { 1.0 - u } else { u }
}

/// Shares of the sides along x, y and z of a box, by the absolute normal. They blend where it lies between two or three of
/// them, as in Cycles' `svm_node_tex_image_box`: in barycentric coordinates of the triangle of all directions of an octant,
/// corners belong to one side, and a smaller triangle in the middle to all three.
fn side_weights(normal: Vec3, blend: f32) -> Vec3 {
    let n = normal / normal.element_sum();
    let limit = 0.5 * (1.0 + blend);
    let between = |a: f32, b: f32| ((a / (a + b) - 0.5 * (1.0 - blend)) / blend).clamp(0.0, 1.0);
    if n.x > limit * (n.x + n.y) && n.x > limit * (n.x + n.z) {
        Vec3::X
    } else if n.y > limit * (n.x + n.y) && n.y > limit * (n.y + n.z) {
        Vec3::Y
    } else if n.z > limit * (n.x + n.z) && n.z > limit * (n.y + n.z) {
        Vec3::Z
    } else if blend <= 0.0 {
        Vec3::X
    } else if n.z < (1.0 - limit) * (n.x + n.y) {
        let share = between(n.x, n.y);
        Vec3::new(share, 1.0 - share, 0.0)
    } else if n.x < (1.0 - limit) * (n.y + n.z) {
        let share = between(n.y, n.z);
        Vec3::new(0.0, share, 1.0 - share)
    } else if n.y < (1.0 - limit) * (n.x + n.z) {
        let share = between(n.x, n.z);
        Vec3::new(share, 0.0, 1.0 - share)
    } else {
        (n * (2.0 - limit) + (limit - 1.0)) / (2.0 * limit - 1.0)
    }
}

/// Longitude and latitude of a direction, each 0..1.
fn on_sphere(at: Vec3) -> Vec2 {
    let length = at.length();
    if length == 0.0 {
        return Vec2::ZERO;
    }
    let u = if at.x == 0.0 && at.y == 0.0 { 0.0 } else { 0.5 - at.x.atan2(at.y) / TAU };
    Vec2::new(u, 1.0 - (at.z / length).clamp(-1.0, 1.0).acos() * FRAC_1_PI)
}

/// Angle about the z axis and height, each 0..1.
fn on_tube(at: Vec3) -> Vec2 {
    if at.x == 0.0 && at.y == 0.0 {
        return Vec2::ZERO;
    }
    Vec2::new(0.5 - at.x.atan2(at.y) / TAU, 0.5 * (at.z + 1.0))
}

/// Place on the picture of a mirroring ball at which a direction is seen: there the ball's normal is halfway between it and
/// the viewer.
fn on_mirror_ball(direction: Vec3) -> Vec2 {
    let halfway = direction - Vec3::Y;
    let scale = 2.0 * (-0.5 * halfway.y).max(0.0).sqrt();
    let normal = if scale > 0.0 { halfway / scale } else { halfway };
    Vec2::new(normal.x + 1.0, normal.z + 1.0) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile_at(uv: [f32; 2]) -> (usize, [f32; 2]) {
        let tiles = [Tile { number: 1001, texture: 1 }, Tile { number: 1012, texture: 2 }];
        let (interpolation, extension) = (Interpolation::Linear, Extension::Repeat);
        let image = Image { texture: 0, tiles: &tiles, interpolation, extension, straight: false };
        let (texture, uv) = image.tile(uv.into());
        (texture, uv.to_array())
    }

    #[test]
    fn tiles_are_counted_in_rows_of_ten() {
        assert_eq!(tile_at([0.25, 0.5]), (1, [0.25, 0.5]));
        assert_eq!(tile_at([1.25, 1.5]), (2, [0.25, 0.5]));
        for outside in [[1.25, 0.5], [11.25, 0.5], [-1.25, 0.5], [3e9, 0.5], [0.25, 3e9], [f32::NAN, 9.5]] {
            assert_eq!(tile_at(outside).0, 0, "{outside:?}");
        }
    }

    #[test]
    fn shares_of_sides_sum_to_one_and_meet_at_the_edges() {
        for blend in [0.0, 0.2, 1.0] {
            for (x, y) in (0..=20).flat_map(|x| (0..=20 - x).map(move |y| (x, y))) {
                let normal = Vec3::new(x as f32, y as f32, (20 - x - y) as f32);
                let weights = side_weights(normal.normalize(), blend);
                assert!(
                    (weights.element_sum() - 1.0).abs() < 1e-5 && weights.min_element() >= 0.0,
                    "{weights}"
                );
            }
        }
        assert_eq!(side_weights(Vec3::new(0.1, 0.2, 0.9), 0.2), Vec3::Z);
        assert!((side_weights(Vec3::new(0.5, 0.5, 0.0), 0.2) - Vec3::new(0.5, 0.5, 0.0)).length() < 1e-6);
    }

    #[test]
    fn a_sphere_is_looked_up_by_longitude_and_latitude() {
        assert!((on_sphere(Vec3::Y) - Vec2::new(0.5, 0.5)).length() < 1e-6);
        assert!((on_sphere(Vec3::X) - Vec2::new(0.25, 0.5)).length() < 1e-6);
        assert_eq!(on_sphere(Vec3::Z * 3.0), Vec2::new(0.0, 1.0));
        assert!((on_tube(Vec3::new(0.0, -2.0, 0.5)).y - 0.75).abs() < 1e-6);
    }

    #[test]
    fn a_mirror_ball_shows_its_front_in_the_middle() {
        assert!((on_mirror_ball(-Vec3::Y) - Vec2::splat(0.5)).length() < 1e-6);
        let aside = on_mirror_ball(Vec3::X);
        assert!(
            (aside - Vec2::new(0.5 + 0.5 * std::f32::consts::FRAC_1_SQRT_2, 0.5)).length() < 1e-6,
            "{aside}"
        );
    }
}
