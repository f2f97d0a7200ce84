//! Displacement: its vectors, offsets of vertices, and shading that remembers the shape before.

use glam::{Vec3, Vec4};
use relume_scene::{Node, NormalSpace, STILL, Scene, SurfaceBase, Undisplaced};

use super::coordinates::{self, footprint_axes};
use super::evaluate::{Known, ShadingContext, bumped};
use super::graph::{Aid, Offset};
use super::values::NodeInputs;
use super::{Hit, PreparedMaterials, RayInfo, SurfacePoint};

/// Barycentric coordinates of the corners of a triangle.
const CORNERS: [[f32; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

impl PreparedMaterials {
    /// Offset that a material gives to vertices; nothing if it moves none.
    pub(crate) fn offset(&self, material: usize) -> Option<&Offset> {
        self.graph(material).displacement.as_ref()
    }

    /// Object-space offset of a corner of a triangle of an instance, 0 along axes where it is no finite number.
    /// `normal` is the object-space normal that they see. As in Cycles' `shader_setup_from_displace`, the point is seen
    /// along it, and nothing is known of its surroundings.
    pub(crate) fn displacement(
        &self,
        scene: &Scene,
        [instance, triangle]: [u32; 2],
        corner: usize,
        normal: Vec3,
        values: &mut Vec<Vec4>,
    ) -> Vec3 {
        let placed = &scene.instances[instance as usize];
        let Some(material) = placed.material_of(scene, triangle as usize) else { return Vec3::ZERO };
        let (graph, Some(mesh)) = (self.graph(material), scene.mesh(placed.geometry)) else {
            return Vec3::ZERO;
        };
        let Some(offset) = &graph.displacement else { return Vec3::ZERO };
        let barycentrics = CORNERS[corner];
        let front = Hit::on(scene, [instance, triangle], barycentrics, 0.0).front.normalize_or(Vec3::Z);
        let shading_normal = self.world_normal(instance, STILL, normal);
        let shading_normal = if shading_normal == Vec3::ZERO { front } else { shading_normal };
        let position = mesh.undisplaced_corners(triangle as usize)[corner];
        let point = SurfacePoint {
            position: placed.world_from_object.transform_point3(position),
            geometric_normal: front,
            shading_normal,
            wo: shading_normal,
            backfacing: false,
            instance,
            geometry: placed.geometry,
            primitive: triangle,
            barycentrics,
            ray_length: 0.0,
            footprint: 0.0,
            strand: None,
            time: STILL,
            ray: RayInfo::default(),
        };
        let context =
            ShadingContext { prepared: self, scene, graph, point: &point, assumed: &[], probes: None };
        values.resize(graph.nodes.len(), Vec4::ZERO);
        context.run(&offset.needs, values, &mut []);
        let moved = Known { context: &context, values }.vector(&offset.input);
        let moved = self.object_direction(instance, STILL, moved);
        Vec3::select(moved.is_finite_mask(), moved, Vec3::ZERO)
    }
}

impl<'a> ShadingContext<'a> {
    /// Shape of the mesh before displacement; nothing if it was not displaced.
    pub(super) fn undisplaced(&self) -> Option<&'a Undisplaced> {
        self.mesh()?.undisplaced.as_ref()
    }

    /// Object-space place of the point before displacement and motion; nothing if its mesh keeps its shape.
    pub(super) fn rest_position(&self) -> Option<Vec3> {
        let mesh = self.mesh().filter(|mesh| mesh.undisplaced.is_some() || !mesh.motion.is_empty())?;
        let [a, b, c] = mesh.undisplaced_corners(self.point.primitive as usize);
        let [u, v] = self.point.barycentrics;
        Some(a * (1.0 - u - v) + b * u + c * v)
    }

    /// World-space unit normal before displacement, on the side of the ray; nothing if the mesh was not displaced.
    fn undisplaced_normal(&self) -> Option<Vec3> {
        let before = self.undisplaced()?;
        let normal = if before.corner_normals.is_empty() {
            let [a, b, c] = self.mesh()?.undisplaced_corners(self.point.primitive as usize);
            (b - a).cross(c - a)
        } else {
            self.interpolate(|corner| before.corner_normals[corner])
        };
        Some(self.prepared.world_normal(self.point.instance, self.point.time, normal) * self.side())
    }

    fn side(&self) -> f32 {
        if self.point.backfacing { -1.0 } else { 1.0 }
    }

    /// A displacement by a vector in a space, as a vector in world space (Cycles' `svm_node_vector_displacement`).
    pub(super) fn vector_displacement(&self, space: NormalSpace, vector: Vec3, uv_map: usize) -> Vec3 {
        let world_from_object = self.world_from_object().matrix3;
        let in_object = match space {
            NormalSpace::World | NormalSpace::BlenderWorld => return vector,
            NormalSpace::Object | NormalSpace::BlenderObject => vector,
            NormalSpace::Tangent => {
                let base = SurfaceBase::Undisplaced;
                let tangents = self.prepared.tangents(self.point.geometry, uv_map, base);
                let Some(tangents) = tangents.filter(|_| self.mesh().is_some()) else { return Vec3::ZERO };
                let tangent = self.interpolate(|corner| tangents[corner].truncate());
                let sign = self.interpolate(|corner| tangents[corner].w);
                let normal = self.prepared.object_normal(
                    self.point.instance,
                    self.point.time,
                    self.point.shading_normal,
                );
                let bitangent = normal.cross(tangent).normalize_or_zero() * sign;
                tangent * vector.x + normal * vector.y + bitangent * vector.z
            }
        };
        world_from_object * in_object
    }

    /// A normal map whose tangent space is that of the mesh before displacement.
    pub(super) fn undisplaced_normal_map(&self, uv_map: usize, strength: f32, color: Vec3) -> Vec3 {
        let point = self.point;
        let tangents = self.prepared.tangents(point.geometry, uv_map, SurfaceBase::Undisplaced);
        let (Some(tangents), Some(before)) = (tangents, self.undisplaced()) else {
            return point.shading_normal;
        };
        if before.corner_normals.is_empty() {
            return self.normal_map(NormalSpace::Tangent, SurfaceBase::Shaded, uv_map, strength, color);
        }
        let tangent = self.interpolate(|corner| tangents[corner].truncate());
        let sign = self.interpolate(|corner| tangents[corner].w);
        let normal = self.interpolate(|corner| before.corner_normals[corner]);
        let bent = tangent * color.x + normal.cross(tangent) * (sign * color.y) + normal * color.z;
        let mapped = self.prepared.world_normal(point.instance, point.time, bent) * self.side();
        point.shading_normal.lerp(mapped, strength.max(0.0)).normalize_or(point.shading_normal)
    }

    /// The point as it was before displacement.
    fn undisplaced_point(&self, base: SurfaceBase) -> SurfacePoint {
        let mut point = *self.point;
        if let Some(position) = self.undisplaced().and_then(|_| self.rest_position()) {
            point.position = self.world_from_object().transform_point3(position);
        }
        if let Some(normal) = self.undisplaced_normal().filter(|_| base == SurfaceBase::Undisplaced) {
            point.shading_normal = normal;
        }
        point
    }

    /// Bump of heights that have displaced the surface already: taken before displacement and in object space, as Cycles
    /// does where a material both displaces and bumps.
    pub(super) fn undisplaced_bump(
        &self,
        index: usize,
        base: SurfaceBase,
        values: &[Vec4],
        scratch: &mut [Vec4],
    ) -> Vec3 {
        let known = Known { context: self, values };
        let point = self.undisplaced_point(base);
        let (
            Node::Bump { invert, strength, distance, filter_width, height, normal, .. },
            Aid::Height(needed),
        ) = (&self.graph.nodes[index], &self.graph.aids[index])
        else {
            return point.shading_normal;
        };
        let normal = normal.as_ref().map_or(point.shading_normal, |input| known.vector(input));
        if scratch.is_empty() || needed.is_empty() {
            return normal;
        }
        let step = known.float(filter_width).max(1e-4) * self.point.footprint;
        let (x, y) = footprint_axes(self.point.geometric_normal);
        let mut height_at = |point: &SurfacePoint| {
            let context = ShadingContext { point, ..*self };
            context.run(needed, scratch, &mut []);
            Known { context: &context, values: scratch }.float(height)
        };
        let here = height_at(&point);
        let [(dx, along_x), (dy, along_y)] = [x, y].map(|axis| {
            let shifted = coordinates::shifted(self, axis * step);
            let shifted = ShadingContext { point: &shifted, ..*self }.undisplaced_point(base);
            let moved =
                self.prepared.object_direction(point.instance, point.time, shifted.position - point.position);
            (moved, height_at(&shifted) - here)
        });
        let in_object = self.prepared.object_normal(point.instance, point.time, normal);
        let distance = known.float(distance) * if *invert { -1.0 } else { 1.0 };
        let Some(bumped) = bumped(in_object, [dx, dy], [along_x, along_y], distance) else { return normal };
        let mixed = in_object.lerp(bumped, known.float(strength).max(0.0));
        let bumped = self.prepared.world_normal(point.instance, point.time, mixed);
        if bumped == Vec3::ZERO { normal } else { bumped }
    }
}
