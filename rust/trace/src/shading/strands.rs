//! Attributes of strands and points at a hit, and the facts that Hair Info and Point Info give.

use glam::{Vec2, Vec3, Vec4};
use relume_scene::{Curves, Scene};

use super::evaluate::ShadingContext;
use super::SurfacePoint;
use super::procedural::random_of_words;

/// Facts about a place on a strand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandInfo {
    /// Share of the strand's length before the place, 0 at the root.
    pub intercept: f32,
    /// Length of the strand, object space, metres.
    pub length: f32,
    /// Diameter at the place, metres. Of an object that is not scaled evenly, Cycles' mean over the axes.
    pub thickness: f32,
    /// Random number of the strand, 0..1.
    pub random: f32,
}

/// Facts about a sphere of a point cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointInfo {
    /// Centre, world space, metres.
    pub position: Vec3,
    /// Radius, metres; scaled as [`StrandInfo::thickness`].
    pub radius: f32,
    /// Random number of the sphere, 0..1.
    pub random: f32,
}

impl SurfacePoint {
    /// The strand that the point is on; nothing on other geometry.
    pub fn strand_info(&self, scene: &Scene) -> Option<StrandInfo> {
        let (curves, strand) = (scene.curves(self.geometry)?, self.strand?);
        let curve = curves.curve_of(self.primitive as usize);
        let lengths = curves.lengths(curve, self.primitive as usize);
        Some(StrandInfo {
            intercept: lengths.intercept(self.barycentrics[0]),
            length: lengths.total,
            thickness: 2.0 * strand.radius * self.mean_scale(scene),
            random: random_of(curves.first_number as usize + curve),
        })
    }

    /// The sphere that the point is on; nothing on other geometry.
    pub fn point_info(&self, scene: &Scene) -> Option<PointInfo> {
        let points = scene.points(self.geometry)?;
        let number = self.primitive as usize;
        let world_from_object = scene.instances[self.instance as usize].world_from_object;
        Some(PointInfo {
            position: world_from_object.transform_point3(points.positions[number]),
            radius: points.radii[number] * self.mean_scale(scene),
            random: random_of(number),
        })
    }

    /// Length of the diagonal direction once it is transformed to the world.
    fn mean_scale(&self, scene: &Scene) -> f32 {
        let world_from_object = scene.instances[self.instance as usize].world_from_object.matrix3;
        (world_from_object * Vec3::splat(3.0_f32.sqrt().recip())).length()
    }
}

/// Cycles' random number of a strand or point.
fn random_of(number: usize) -> f32 {
    random_of_words([number as u32, 0])
}

fn curves<'a>(context: &ShadingContext<'a>) -> Option<&'a Curves> {
    context.scene.curves(context.point.geometry)
}

/// Number of the curve that the point is on.
fn curve(context: &ShadingContext) -> Option<usize> {
    Some(curves(context)?.curve_of(context.point.primitive as usize))
}

/// Generated coordinates of the root of the strand, if there are any.
pub fn generated(context: &ShadingContext) -> Option<Vec3> {
    let generated = &curves(context)?.generated;
    if generated.is_empty() { None } else { generated.get(curve(context)?).copied() }
}

/// Coordinates in a UV map of strands or points.
pub fn uv(context: &ShadingContext, map: usize) -> Vec2 {
    let found = match (curves(context), context.scene.points(context.point.geometry)) {
        (Some(curves), _) => curve(context).map(|curve| curves.uv_maps[map].coords[curve]),
        (_, Some(points)) => points.uv_maps[map].coords.get(context.point.primitive as usize).copied(),
        _ => None,
    };
    found.unwrap_or_default()
}

/// An attribute with a value a key or point: linear along a span.
pub fn color(context: &ShadingContext, map: usize) -> Option<Vec4> {
    let at = context.point.primitive as usize;
    if let Some(points) = context.scene.points(context.point.geometry) {
        return points.attributes[map].colors.get(at).copied().map(Vec4::from);
    }
    let colors = &curves(context)?.key_attributes[map].colors;
    Some(Vec4::from(colors[at]).lerp(Vec4::from(colors[at + 1]), context.point.barycentrics[0]))
}

/// An attribute with a value a curve.
pub fn curve_color(context: &ShadingContext, map: usize) -> Option<Vec4> {
    Some(Vec4::from(curves(context)?.curve_attributes[map].colors[curve(context)?]))
}
