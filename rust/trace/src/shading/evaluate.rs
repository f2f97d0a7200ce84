//! Values of nodes at a surface point.

use glam::{Affine3A, Vec2, Vec3, Vec4};
use relume_scene::{
    Input, Instance, Mesh, Node, NodeId, NormalSpace, Output, Scene, SurfaceBase, TangentKind,
};

use super::coordinates;
use super::graph::{Aid, Graph, rotation};
use super::image::Image;
use super::prepared::NamedAttribute;
use super::probes::Occlusion;
use super::raycast::Cast;
use super::values::{NodeInputs, evaluate_pure};
use super::{PointInfo, PreparedMaterials, Probes, StrandInfo, SurfacePoint, procedural, strands};
use crate::bsdf;

/// Point at which a graph is evaluated.
#[derive(Clone, Copy)]
pub struct ShadingContext<'a> {
    pub prepared: &'a PreparedMaterials,
    pub scene: &'a Scene,
    pub graph: &'a Graph,
    pub point: &'a SurfacePoint,
    /// Values that grids are taken to have at the point, by their name numbers.
    pub assumed: &'a [(usize, Vec4)],
    /// Rays of nodes that look around; nothing where they cannot.
    pub(super) probes: Option<&'a Probes<'a>>,
}

/// A context with the values known so far.
pub struct Known<'a, 'v> {
    pub context: &'a ShadingContext<'a>,
    pub values: &'v [Vec4],
}

impl NodeInputs for Known<'_, '_> {
    fn link(&self, node: NodeId, output: Output) -> Vec4 {
        let (context, point) = (self.context, self.context.point);
        let instance = context.instance();
        let flag = |is_so: bool| Vec4::splat(f32::from(is_so));
        let of_strand =
            |fact: fn(StrandInfo) -> f32| Vec4::splat(point.strand_info(context.scene).map_or(0.0, fact));
        let of_point =
            |fact: fn(PointInfo) -> f32| Vec4::splat(point.point_info(context.scene).map_or(0.0, fact));
        match output {
            Output::Position => point.position.extend(1.0),
            Output::TrueNormal => point.geometric_normal.extend(1.0),
            Output::Incoming => point.wo.extend(1.0),
            Output::Backfacing => flag(point.backfacing),
            Output::Parametric => {
                let [u, v] = point.barycentrics;
                Vec4::new(1.0 - u - v, u, 0.0, 1.0)
            }
            Output::Tangent => context.tangent().extend(1.0),
            Output::Location => Vec3::from(context.world_from_object().translation).extend(1.0),
            Output::ObjectIndex => Vec4::splat(instance.pass_index as f32),
            Output::Random => Vec4::splat(instance.random),
            Output::IsStrand => flag(point.strand.is_some()),
            Output::Intercept => of_strand(|strand| strand.intercept),
            Output::Length => of_strand(|strand| strand.length),
            Output::Thickness => of_strand(|strand| strand.thickness),
            Output::StrandRandom => Vec4::splat(point.strand_random(context.scene).unwrap_or_default()),
            Output::TangentNormal => context.tangent_normal().extend(1.0),
            Output::PointPosition => {
                point.point_info(context.scene).map_or(Vec3::ZERO, |info| info.position).extend(1.0)
            }
            Output::PointRadius => of_point(|info| info.radius),
            Output::PointRandom => of_point(|info| info.random),
            Output::IsCameraRay => flag(point.ray.is_camera),
            Output::IsShadowRay => flag(point.ray.is_shadow),
            Output::IsDiffuseRay => flag(point.ray.is_diffuse),
            Output::IsGlossyRay => flag(point.ray.is_glossy),
            Output::IsSingularRay => flag(point.ray.is_singular),
            Output::IsReflectionRay => flag(point.ray.is_reflection),
            Output::IsTransmissionRay => flag(point.ray.is_transmission),
            Output::IsVolumeScatterRay => flag(point.ray.is_volume_scatter),
            Output::RayLength => Vec4::splat(point.position.distance(point.ray.origin)),
            Output::RayDepth => Vec4::splat(point.ray.depth as f32),
            Output::DiffuseDepth => Vec4::splat(point.ray.diffuse_depth as f32),
            Output::GlossyDepth => Vec4::splat(point.ray.glossy_depth as f32),
            Output::TransmissionDepth => Vec4::splat(point.ray.transmission_depth as f32),
            Output::PortalDepth => Vec4::splat(point.ray.portal_depth as f32),
            Output::TransparentDepth => Vec4::splat(point.ray.transparent_depth as f32),
            _ => self.values[node as usize],
        }
    }
}

impl Known<'_, '_> {
    /// A normal input as it is, the shading normal if there is none.
    fn raw_normal(&self, input: &Option<Input>) -> Vec3 {
        input.as_ref().map_or(self.context.point.shading_normal, |input| self.vector(input))
    }

    /// A normal input: unit length, the shading normal if there is none.
    pub fn normal(&self, input: &Option<Input>) -> Vec3 {
        let smooth = self.context.point.shading_normal;
        input.as_ref().map_or(smooth, |input| self.vector(input).normalize_or(smooth))
    }

    /// A tangent input; the radial tangent if there is none.
    pub fn tangent(&self, input: &Option<Input>) -> Vec3 {
        input.as_ref().map_or_else(|| self.context.tangent(), |input| self.vector(input))
    }
}

impl<'a> ShadingContext<'a> {
    pub fn instance(&self) -> &'a Instance {
        self.scene.instances.get(self.point.instance as usize).unwrap_or(&self.prepared.space)
    }

    /// Transform of the instance at the time of the ray.
    pub fn world_from_object(&self) -> Affine3A {
        self.instance().world_from_object_at(self.point.time)
    }

    /// The mesh that the point is on; nothing for other geometry, and within media.
    pub fn mesh(&self) -> Option<&'a Mesh> {
        self.scene.mesh(self.point.geometry).filter(|_| !self.point.is_in_medium())
    }

    /// Evaluates `nodes` in order. `scratch` holds values of bump heights at shifted points.
    pub fn run(&self, nodes: &[NodeId], values: &mut [Vec4], scratch: &mut [Vec4]) {
        for &node in nodes {
            values[node as usize] = self.evaluate(node as usize, values, scratch);
        }
    }

    fn evaluate(&self, index: usize, values: &[Vec4], scratch: &mut [Vec4]) -> Vec4 {
        let node = &self.graph.nodes[index];
        let known = Known { context: self, values };
        if let Some(value) = evaluate_pure(node, &known) {
            return value;
        }
        let vector = match node {
            Node::ImageTexture { texture, tiles, vector, interpolation, extension, projection } => {
                let at = vector.as_ref().map_or_else(|| self.uv(0), |vector| known.vector(vector));
                let straight = matches!(self.graph.aids[index], Aid::StraightColor);
                let (texture, interpolation, extension) = (*texture, *interpolation, *extension);
                let image = Image { texture, tiles, interpolation, extension, straight };
                return image.projected(self, *projection, at);
            }
            Node::Procedural(texture) => {
                let generated = || coordinates::generated(self);
                let at = texture.vector().as_ref().map_or_else(generated, |vector| known.vector(vector));
                let colored = matches!(self.graph.aids[index], Aid::Colored);
                return procedural::evaluate(texture, at, &known, colored);
            }
            Node::Ies { profile, strength, vector } => {
                let back =
                    || self.prepared.object_normal(self.point.instance, self.point.time, self.point.wo);
                let direction = vector.as_ref().map_or_else(back, |vector| known.vector(vector));
                return Vec4::splat(known.float(strength) * profile.strength(direction));
            }
            Node::TextureCoordinate { kind } => coordinates::coordinate(self, *kind),
            Node::UvMap { .. } => self.uv(self.attribute(index)),
            Node::ColorAttribute { .. } => return self.named(self.attribute(index)).unwrap_or_default(),
            Node::Attribute { .. } => return self.named(self.attribute(index)).unwrap_or(Vec4::W),
            Node::Displacement { world_space, height, midlevel, scale, normal } => {
                let along = known.raw_normal(normal);
                let height = (known.float(height) - known.float(midlevel)) * known.float(scale);
                self.displacement(*world_space, along, height)
            }
            Node::VectorDisplacement { space, vector, midlevel, scale } => {
                let vector = (known.vector(vector) - known.float(midlevel)) * known.float(scale);
                self.vector_displacement(*space, vector, self.attribute(index))
            }
            Node::Mapping { kind, vector, location, rotation: angles, scale } => {
                let rotation = match &self.graph.aids[index] {
                    Aid::Rotation(rotation) => *rotation,
                    _ => rotation(known.vector(angles)),
                };
                let (location, scale) = (known.vector(location), known.vector(scale));
                coordinates::mapping(*kind, known.vector(vector), location, rotation, scale)
            }
            Node::NormalMap { space, strength, color, base, .. } => {
                let color = known.vector(color) * 2.0 - 1.0;
                let (uv_map, strength) = (self.attribute(index), known.float(strength));
                match (space, base, self.undisplaced()) {
                    (NormalSpace::Tangent, SurfaceBase::Undisplaced, Some(_)) => {
                        self.undisplaced_normal_map(uv_map, strength, color)
                    }
                    _ => self.normal_map(*space, *base, uv_map, strength, color),
                }
            }
            Node::Bump { base: SurfaceBase::Shaded, .. } => self.bump(index, values, scratch),
            Node::Bump { base, .. } => self.undisplaced_bump(index, *base, values, scratch),
            Node::AmbientOcclusion { samples, inside, only_local, color, distance, normal } => {
                let normal = known.normal(normal);
                let axis = if *inside { -normal } else { normal };
                let (samples, only_local) = (*samples, *only_local);
                let occlusion = Occlusion { axis, distance: known.float(distance), samples, only_local };
                let openness = self.probes.map_or(1.0, |probes| probes.openness(self, &occlusion));
                return (known.vector(color) * openness).extend(openness);
            }
            Node::Bevel { samples, radius, normal } => {
                let smooth = self.point.shading_normal;
                let radius = known.float(radius);
                let rounded =
                    self.probes.map_or(smooth, |probes| probes.rounded_normal(self, radius, *samples));
                match normal {
                    Some(normal) => (known.vector(normal) + (rounded - smooth)).normalize_or(smooth),
                    None => rounded,
                }
            }
            Node::Raycast { asked, only_local, position, direction, length } => {
                let position = position.as_ref().map_or(self.point.position, |input| known.vector(input));
                let direction =
                    direction.as_ref().map_or(self.point.shading_normal, |input| known.vector(input));
                let cast = Cast { position, direction, length: known.float(length), only_local: *only_local };
                return cast.tell(self, *asked);
            }
            Node::Tangent { kind, .. } => self.chosen_tangent(*kind, self.attribute(index)),
            Node::Wireframe { in_pixels, size } => {
                return Vec4::splat(f32::from(self.is_near_edge(*in_pixels, known.float(size))));
            }
            Node::Geometry => self.point.shading_normal,
            Node::ObjectInfo => return Vec4::from(self.instance().color),
            Node::Fresnel { ior, normal } => {
                let ior = known.float(ior).max(1e-5);
                let eta = if self.point.backfacing { 1.0 / ior } else { ior };
                return Vec4::splat(bsdf::dielectric(known.raw_normal(normal).dot(self.point.wo), eta).0);
            }
            Node::LayerWeight { blend, normal } => {
                return self.layer_weight(known.float(blend), known.raw_normal(normal));
            }
            _ => Vec3::ZERO,
        };
        vector.extend(1.0)
    }

    fn attribute(&self, node: usize) -> usize {
        match self.graph.aids[node] {
            Aid::Attribute(number) => number,
            _ => 0,
        }
    }

    /// UV coordinates of the active map.
    pub fn active_uv(&self) -> Vec3 {
        self.uv(0)
    }

    /// UV coordinates of the named map with this number; 0 where the mesh lacks it.
    fn uv(&self, name: usize) -> Vec3 {
        let Some(map) = self.prepared.uv_map(self.point.geometry, name) else { return Vec3::ZERO };
        self.interpolate_uv(map).extend(0.0)
    }

    fn interpolate_uv(&self, map: usize) -> Vec2 {
        let Some(mesh) = self.mesh() else { return strands::uv(self, map) };
        let coords = &mesh.uv_maps[map].coords;
        self.interpolate(|corner| coords[corner])
    }

    /// The attribute with this name number, alpha 1 for a UV map; nothing where the mesh lacks it.
    fn named(&self, name: usize) -> Option<Vec4> {
        if self.point.is_in_medium() {
            return self.field(name);
        }
        let Some(attribute) = self.prepared.attribute(self.point.geometry, name) else {
            return self.prepared.attribute_of_object(self.point.instance, name);
        };
        Some(match attribute {
            NamedAttribute::Color(map) => match self.mesh() {
                Some(mesh) => {
                    let colors = &mesh.color_attributes[map].colors;
                    self.interpolate(|corner| Vec4::from(colors[corner]))
                }
                None => strands::color(self, map)?,
            },
            NamedAttribute::Curve(map) => strands::curve_color(self, map)?,
            NamedAttribute::Uv(map) => self.interpolate_uv(map).extend(0.0).extend(1.0),
        })
    }

    /// Value at a point within a medium of the grid with this name number; nothing where its object has none. Meshes have none.
    pub fn field(&self, name: usize) -> Option<Vec4> {
        if let Some((_, value)) = self.assumed.iter().find(|(assumed, _)| *assumed == name) {
            return Some(*value);
        }
        self.prepared.field(self.scene, (self.point.instance, self.point.time), name, self.point.position)
    }

    /// A height along a world-space normal as a vector in world space. A height in object space is scaled with the object.
    fn displacement(&self, world_space: bool, normal: Vec3, height: f32) -> Vec3 {
        if world_space {
            return normal * height;
        }
        let world_from_object = self.world_from_object().matrix3;
        let in_object = (world_from_object.transpose() * normal).normalize_or_zero();
        world_from_object * in_object * height
    }

    pub(super) fn interpolate<T>(&self, at_corner: impl Fn(usize) -> T) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let corner = 3 * self.point.primitive as usize;
        let [u, v] = self.point.barycentrics;
        at_corner(corner) * (1.0 - u - v) + at_corner(corner + 1) * u + at_corner(corner + 2) * v
    }

    /// World-space tangent: along a strand, else about the z axis of the object's bounding box, as Blender has it without a
    /// UV map.
    fn tangent(&self) -> Vec3 {
        if let Some(strand) = &self.point.strand {
            return strand.tangent.normalize_or_zero();
        }
        self.chosen_tangent(TangentKind::Z, 0)
    }

    pub(super) fn normal_map(
        &self,
        space: NormalSpace,
        base: SurfaceBase,
        uv_map: usize,
        strength: f32,
        color: Vec3,
    ) -> Vec3 {
        let point = self.point;
        let side = if point.backfacing { -1.0 } else { 1.0 };
        let smooth = point.shading_normal;
        let blender_axes = Vec3::new(1.0, -1.0, -1.0);
        let normal = match space {
            NormalSpace::Tangent => {
                let tangents = self.prepared.tangents(point.geometry, uv_map, base);
                let Some(tangents) = tangents.filter(|_| self.mesh().is_some()) else { return smooth };
                let tangent = self.interpolate(|corner| tangents[corner].truncate());
                let sign = self.interpolate(|corner| tangents[corner].w);
                let normal = self.object_normal();
                let up = 1.0 + (color.z - 1.0) * strength.clamp(0.0, 1.0);
                let bent = tangent * (color.x * strength)
                    + normal.cross(tangent) * (sign * color.y * strength)
                    + normal * up;
                return (self.prepared.world_normal(point.instance, point.time, bent) * side)
                    .normalize_or(smooth);
            }
            NormalSpace::Object => self.prepared.world_normal(point.instance, point.time, color),
            NormalSpace::World => color.normalize_or_zero(),
            NormalSpace::BlenderObject => {
                self.prepared.world_normal(point.instance, point.time, color * blender_axes)
            }
            NormalSpace::BlenderWorld => (color * blender_axes).normalize_or_zero(),
        };
        smooth.lerp(normal * side, strength.max(0.0)).normalize_or(smooth)
    }

    /// Interpolated object-space normal, not normalised, on the front whatever the side of the ray.
    fn object_normal(&self) -> Vec3 {
        match self.mesh() {
            Some(mesh) if !mesh.corner_normals.is_empty() => {
                let point = self.point;
                let [a, b, c] =
                    self.prepared.corner_normals_at(point.geometry, mesh, point.primitive, point.time);
                let [u, v] = point.barycentrics;
                a * (1.0 - u - v) + b * u + c * v
            }
            _ => {
                let side = if self.point.backfacing { -1.0 } else { 1.0 };
                self.prepared.object_normal(
                    self.point.instance,
                    self.point.time,
                    self.point.geometric_normal * side,
                )
            }
        }
    }

    /// Mikkelsen, "Bump Mapping Unparametrized Surfaces on the GPU" (2010), with heights at points shifted by
    /// `filter_width` times the ray's footprint.
    fn bump(&self, index: usize, values: &[Vec4], scratch: &mut [Vec4]) -> Vec3 {
        let known = Known { context: self, values };
        let Node::Bump { invert, strength, distance, filter_width, height, normal, .. } =
            &self.graph.nodes[index]
        else {
            return self.point.shading_normal;
        };
        let normal = known.raw_normal(normal);
        let Aid::Height(needed) = &self.graph.aids[index] else { return normal };
        // Heights within heights would need values of their own; none of Blender's graphs bumps a height.
        if scratch.is_empty() || needed.is_empty() {
            return normal;
        }
        let step = known.float(filter_width).max(1e-4) * self.point.footprint;
        let (x, y) = coordinates::footprint_axes(self.point.geometric_normal);
        let (dx, dy) = (x * step, y * step);
        let here = known.float(height);
        let mut height_at = |offset: Vec3| {
            let point = coordinates::shifted(self, offset);
            let shifted = ShadingContext { point: &point, ..*self };
            shifted.run(needed, scratch, &mut []);
            Known { context: &shifted, values: scratch }.float(height)
        };
        let along = [height_at(dx) - here, height_at(dy) - here];
        let distance = known.float(distance) * if *invert { -1.0 } else { 1.0 };
        let Some(bumped) = bumped(normal, [dx, dy], along, distance) else { return normal };
        normal.lerp(bumped, known.float(strength).max(0.0)).normalize_or(normal)
    }

    fn layer_weight(&self, blend: f32, normal: Vec3) -> Vec4 {
        let cos = normal.dot(self.point.wo);
        let eta = (1.0 - blend).max(1e-5);
        let eta = if self.point.backfacing { eta } else { 1.0 / eta };
        let fresnel = bsdf::dielectric(cos, eta).0;
        let exponent = match blend.clamp(0.0, 1.0 - 1e-5) {
            blend if blend < 0.5 => 2.0 * blend,
            blend => 0.5 / (1.0 - blend),
        };
        let facing = 1.0 - cos.abs().powf(exponent);
        Vec4::new(fresnel, facing, 0.0, 1.0)
    }
}

/// Unit normal of a surface that rises above another one along two steps upon it, times `distance`; nothing where it has
/// none.
pub(super) fn bumped(
    normal: Vec3,
    [dx, dy]: [Vec3; 2],
    [along_x, along_y]: [f32; 2],
    distance: f32,
) -> Option<Vec3> {
    let (rx, ry) = (dy.cross(normal), normal.cross(dx));
    let determinant = dx.dot(rx);
    let gradient = (rx * along_x + ry * along_y) * determinant.signum();
    (normal * determinant.abs() - gradient * distance).try_normalize()
}
