//! Attributes of strands and points at a hit, and the facts that Hair Info and Point Info give.

use glam::{Vec2, Vec3, Vec4};
use relume_scene::{Curves, Scene};

use super::SurfacePoint;
use super::evaluate::ShadingContext;
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

    /// Random number of the strand that the point is on, as in [`StrandInfo`].
    pub fn strand_random(&self, scene: &Scene) -> Option<f32> {
        let curves = scene.curves(self.geometry)?;
        Some(random_of(curves.first_number as usize + curves.curve_of(self.primitive as usize)))
    }

    /// The sphere that the point is on; nothing on other geometry.
    pub fn point_info(&self, scene: &Scene) -> Option<PointInfo> {
        let points = scene.points(self.geometry)?;
        let number = self.primitive as usize;
        let sphere = points.sphere_at(number, self.time);
        let world_from_object = scene.instances[self.instance as usize].world_from_object_at(self.time);
        Some(PointInfo {
            position: world_from_object.transform_point3(sphere.truncate()),
            radius: sphere.w * self.mean_scale(scene),
            random: random_of(number),
        })
    }

    /// Length of the diagonal direction once it is transformed to the world.
    fn mean_scale(&self, scene: &Scene) -> f32 {
        let world_from_object =
            scene.instances[self.instance as usize].world_from_object_at(self.time).matrix3;
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

/// Normal of the curve at the point, object space, of any length; nothing where it has none.
pub fn normal(context: &ShadingContext) -> Option<Vec3> {
    let (normals, key) = (&curves(context)?.normals, context.point.primitive as usize);
    Some(normals.get(key)?.lerp(*normals.get(key + 1)?, context.point.barycentrics[0]))
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

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3};
    use relume_scene::{ColorAttribute, Geometry, Instance, Points, StrandShape, UvMap};

    use super::super::evaluate::ShadingContext;
    use super::super::graph::{Graph, Names};
    use super::super::{Hit, PreparedMaterials};
    use super::*;

    /// A straight ribbon along y, of twice its size in the world.
    fn scene() -> Scene {
        let tint = |name: &str, colors| ColorAttribute { name: name.into(), colors };
        let curves = Curves {
            shape: StrandShape::Ribbon { subdivisions: 0 },
            keys: vec![Vec3::ZERO, Vec3::Y, Vec3::new(0.0, 4.0, 0.0)],
            radii: vec![0.1; 3],
            first_keys: vec![0, 3],
            uv_maps: vec![UvMap { name: "Root".into(), coords: vec![Vec2::new(0.2, 0.7)] }],
            key_attributes: vec![tint("along", vec![[0.0; 4], [1.0; 4], [3.0; 4]])],
            curve_attributes: vec![tint("whole", vec![[0.5; 4]])],
            ..Curves::default()
        };
        let points = Points { positions: vec![Vec3::X], radii: vec![0.5], ..Points::default() };
        let place = Affine3A::from_scale(Vec3::splat(2.0));
        Scene {
            instances: vec![
                Instance::new("hair", Geometry::Curves(0), place, vec![]),
                Instance::new("dust", Geometry::Points(0), place, vec![]),
            ],
            curves: vec![curves],
            points: vec![points],
            ..Scene::default()
        }
    }

    /// Half of the second span, a share `v` across, seen along -z.
    fn on_strand(scene: &Scene, v: f32) -> SurfacePoint {
        let (prepared, _) = PreparedMaterials::new(scene);
        let hit = Hit {
            instance: 0,
            primitive: 1,
            barycentrics: [0.5, v],
            distance: 1.0,
            time: 0.5,
            front: Vec3::Z,
        };
        prepared.surface_point(scene, &hit, Vec3::new(0.2 * v, 5.0, 1.0), Vec3::NEG_Z, 0.0)
    }

    #[test]
    fn ribbons_are_shaded_as_cylinders() {
        let scene = scene();
        for v in [-0.8, 0.0, 0.6] {
            let point = on_strand(&scene, v);
            let round = Vec3::new(v, 0.0, (1.0 - v * v).sqrt());
            assert!(point.shading_normal.distance(round) < 1e-5, "{} {round}", point.shading_normal);
            assert_eq!((point.geometric_normal, point.horizon_normal()), (Vec3::Z, point.shading_normal));
            let tangent = point.strand.unwrap().tangent;
            assert!(tangent.normalize().distance(Vec3::Y) < 1e-5);
        }
    }

    #[test]
    fn strands_and_points_tell_what_blender_shows() {
        let scene = scene();
        let info = on_strand(&scene, 0.0).strand_info(&scene).unwrap();
        assert_eq!((info.length, info.intercept), (4.0, 0.625));
        assert!((info.thickness - 0.4).abs() < 1e-6);
        // Jenkins' hash of (0, 0), as in Cycles.
        assert_eq!(info.random, random_of_words([0, 0]));
        let (prepared, _) = PreparedMaterials::new(&scene);
        let hit = Hit {
            instance: 1,
            primitive: 0,
            barycentrics: [0.0; 2],
            distance: 1.0,
            time: 0.5,
            front: Vec3::Z,
        };
        let point = prepared.surface_point(&scene, &hit, Vec3::new(2.0, 0.0, 2.0), Vec3::NEG_Z, 0.0);
        let info = point.point_info(&scene).unwrap();
        assert_eq!((info.position, info.random), (Vec3::X * 2.0, random_of_words([0, 0])));
        assert!((info.radius - 1.0).abs() < 1e-6 && point.strand_info(&scene).is_none());
    }

    #[test]
    fn attributes_of_keys_are_linear_along_spans_and_those_of_curves_constant() {
        let scene = scene();
        let (prepared, _) = PreparedMaterials::new(&scene);
        let (graph, _) = Graph::new(&relume_scene::Material::default(), &mut Names::default());
        let point = on_strand(&scene, 0.0);
        let context = ShadingContext {
            prepared: &prepared,
            scene: &scene,
            graph: &graph,
            point: &point,
            assumed: &[],
            probes: None,
        };
        assert_eq!(color(&context, 0), Some(Vec4::splat(2.0)));
        assert_eq!(curve_color(&context, 0), Some(Vec4::splat(0.5)));
        assert_eq!(uv(&context, 0), Vec2::new(0.2, 0.7));
        assert_eq!(generated(&context), None);
    }
}
