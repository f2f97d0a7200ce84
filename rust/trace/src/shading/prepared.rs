use glam::{Affine3A, Vec2, Vec3, Vec4};
use relume_scene::{
    ColorAttribute, Curves, Extension, Geometry, Grid, Instance, Interpolation, Material, Mesh, Points, Pose,
    Scene, SurfaceBase, UvMap,
};

use super::closures::shade;
use super::evaluate::{Known, ShadingContext};
use super::fields::PreparedFields;
use super::graph::{Graph, Names};
use super::moving::{Transforms, key_normals};
use super::tangents::{corner_tangents, spherical_coords, undisplaced_positions};
use super::texture::{PreparedTexture, equirectangular};
use super::values::NodeInputs;
use super::volumes::shade_medium;
use super::{Hit, MediumPoint, Probes, RayInfo, StrandPoint, SurfacePoint};
use crate::bsdf::{Scatter, Surface, sample_wavelength};
use crate::media::MediumSample;

/// Everything about materials, textures and transforms that does not depend on the hit.
#[derive(Debug)]
pub struct PreparedMaterials {
    graphs: Vec<Graph>,
    pub(super) textures: Vec<PreparedTexture>,
    pub(super) transforms: Vec<Transforms>,
    /// Poses of each instance; none at all where none moves.
    pub(super) poses: Vec<Vec<Pose>>,
    /// Those of all meshes, and of the nothing that the world's medium is in.
    pub(super) meshes: Vec<PreparedMesh>,
    curves: Vec<Attributes>,
    points: Vec<Attributes>,
    /// Values by name numbers that materials ask each instance for; none of those that have none.
    of_objects: Vec<Vec<Option<Vec4>>>,
    /// Object of the world's medium.
    pub(super) space: Instance,
    fields: PreparedFields,
    /// True if nodes look around by rays of their own.
    pub(crate) looks_around: bool,
    /// True if glass disperses light.
    disperses: bool,
}

/// Everything about one mesh that does not depend on the hit.
#[derive(Debug)]
pub(super) struct PreparedMesh {
    /// Lower corner and size of the box of generated coordinates.
    bounds: (Vec3, Vec3),
    attributes: Attributes,
    /// Corner normals at each key of its motion, key after key; empty if it keeps its shape or is flat.
    pub(super) key_normals: Vec<Vec3>,
}

/// Numbers of a geometry's arrays that the graphs mean by their names.
#[derive(Clone, Debug)]
struct Attributes {
    uv_maps: Vec<Option<usize>>,
    /// Corner tangents by UV map name.
    tangents: Vec<Option<Vec<Vec4>>>,
    /// Those before displacement; none of what was not displaced.
    undisplaced_tangents: Vec<Option<Vec<Vec4>>>,
    named: Vec<Option<NamedAttribute>>,
}

/// Place of an attribute of some name in a geometry.
#[derive(Clone, Copy, Debug)]
pub(super) enum NamedAttribute {
    /// Index of a colour attribute, with a value a corner, key or point.
    Color(usize),
    /// Index of an attribute with a value a curve.
    Curve(usize),
    /// Index of a UV map.
    Uv(usize),
}

impl PreparedMaterials {
    /// Prepares `scene`. The second value says in words what could not be represented.
    pub fn new(scene: &Scene) -> (Self, Vec<String>) {
        // Name 0 is the active UV map, which image textures without a vector use.
        let mut names = Names { uv_maps: vec![String::new()], ..Names::default() };
        let mut warnings = Vec::new();
        let graphs = scene
            .materials
            .iter()
            .map(|material| {
                let (graph, found) = Graph::new(material, &mut names);
                warnings.extend(found);
                graph
            })
            .collect();
        // Generated coordinates of space are those of the world.
        let nothing = Mesh { texture_space: Some([Vec3::splat(0.5); 2]), ..Mesh::default() };
        let space = Instance::new("World", scene.meshes.len(), Affine3A::IDENTITY, Vec::new());
        let prepared = Self {
            graphs,
            textures: scene.textures.iter().map(PreparedTexture::new).collect(),
            transforms: scene
                .instances
                .iter()
                .chain([&space])
                .map(|instance| Transforms::new(instance.world_from_object))
                .collect(),
            poses: if scene.instances.iter().any(|instance| !instance.motion.is_empty()) {
                scene.instances.iter().map(|instance| instance.motion.clone()).collect()
            } else {
                Vec::new()
            },
            meshes: (scene.meshes.iter().chain([&nothing]))
                .map(|mesh| PreparedMesh::new(mesh, &names))
                .collect(),
            curves: scene.curves.iter().map(|curves| attributes_of_curves(curves, &names)).collect(),
            points: scene.points.iter().map(|points| attributes_of_points(points, &names)).collect(),
            of_objects: scene
                .instances
                .iter()
                .map(|instance| attributes_of_object(instance, &names))
                .collect(),
            space,
            fields: PreparedFields::new(scene, &names.attributes),
            looks_around: scene.materials.iter().any(Material::looks_around),
            disperses: scene.materials.iter().any(Material::disperses),
        };
        (prepared, warnings)
    }

    /// The point that a ray from `origin` along the unit `direction` hit. `footprint` is the radius of the ray's
    /// cone there.
    pub fn surface_point(
        &self,
        scene: &Scene,
        hit: &Hit,
        origin: Vec3,
        direction: Vec3,
        footprint: f32,
    ) -> SurfacePoint {
        let instance = &scene.instances[hit.instance as usize];
        let front = hit.front.normalize_or(-direction);
        let strand = scene.curves(instance.geometry).map(|curves| {
            let matrix = instance.world_from_object_at(hit.time).matrix3;
            StrandPoint::new(curves, hit, matrix, self.object_direction(hit.instance, hit.time, direction))
        });
        let smooth = match (scene.mesh(instance.geometry), &strand) {
            (_, Some(strand)) => {
                strand.ribbon_normal.map_or(front, |normal| self.world_normal(hit.instance, hit.time, normal))
            }
            (Some(mesh), _) if !mesh.corner_normals.is_empty() => {
                let [a, b, c] = self.corner_normals_at(instance.geometry, mesh, hit.primitive, hit.time);
                let [u, v] = hit.barycentrics;
                let interpolated = a * (1.0 - u - v) + b * u + c * v;
                self.turned_normal(hit.instance, hit.time, interpolated).normalize_or(front)
            }
            _ => front,
        };
        let backfacing = front.dot(direction) > 0.0;
        let side = if backfacing { -1.0 } else { 1.0 };
        SurfacePoint {
            position: origin + direction * hit.distance,
            geometric_normal: front * side,
            shading_normal: smooth * side,
            wo: -direction,
            backfacing,
            instance: hit.instance,
            geometry: instance.geometry,
            primitive: hit.primitive,
            barycentrics: hit.barycentrics,
            ray_length: hit.distance,
            footprint,
            time: hit.time,
            strand,
            ray: RayInfo { origin, ..RayInfo::default() },
        }
    }

    /// Fills `surface` with the closures and the emission at `point`. Nodes that look around see nothing.
    pub fn evaluate(&self, scene: &Scene, point: &SurfacePoint, surface: &mut Surface) {
        self.evaluate_with(scene, point, None, surface);
    }

    /// Fills `surface`, likewise, with rays for nodes that look around from `point`.
    pub(crate) fn evaluate_with(
        &self,
        scene: &Scene,
        point: &SurfacePoint,
        probes: Option<&Probes<'_>>,
        surface: &mut Surface,
    ) {
        surface.reset(point);
        let instance = &scene.instances[point.instance as usize];
        surface.end_before_horizon(instance.shadow_terminator_shading);
        let Some(material) = instance.material_of(scene, point.primitive as usize) else {
            // Blender's default surface.
            surface.add(Vec3::splat(0.8), Vec3::ONE, point.shading_normal, Scatter::Diffuse);
            return;
        };
        surface.shadow_bumps(scene.materials[material].bump_shadowing);
        let graph = &self.graphs[material];
        if let Some(root) = graph.surface {
            let context = ShadingContext { prepared: self, scene, graph, point, assumed: &[], probes };
            let mut values = surface.take_values(2 * graph.nodes.len());
            let (own, scratch) = values.split_at_mut(graph.nodes.len());
            if let Some(normal) = &graph.normal {
                context.run(&normal.needs, own, scratch);
                let bumped = Known { context: &context, values: own }.vector(&normal.input);
                surface.take_normal(bumped.normalize_or(point.shading_normal));
            }
            shade(&context, root, 1.0, own, scratch, surface);
            surface.give_values(values);
        }
    }

    /// Normal by which light leaves a body at `point`: that of its shader. What is in `surface` is of no meaning after.
    pub(crate) fn exit_normal(
        &self,
        scene: &Scene,
        point: &SurfacePoint,
        probes: Option<&Probes<'_>>,
        surface: &mut Surface,
    ) -> Vec3 {
        let instance = &scene.instances[point.instance as usize];
        let material = instance.material_of(scene, point.primitive as usize);
        if !material.is_some_and(|material| self.graphs[material].bends_exits) {
            return point.shading_normal;
        }
        self.evaluate_with(scene, point, probes, surface);
        surface.body_normal().unwrap_or(point.shading_normal)
    }

    /// Adds to `medium` what the volume of a material is at a point within it; what it would be if grids had the values that are
    /// `assumed`, by their name numbers.
    pub(crate) fn evaluate_medium(
        &self,
        scene: &Scene,
        material: usize,
        point: &MediumPoint,
        assumed: &[(usize, Vec4)],
        values: &mut Vec<Vec4>,
        medium: &mut MediumSample,
    ) {
        let graph = &self.graphs[material];
        let Some(root) = graph.volume else { return };
        let position = self.before_moving(scene, (point.instance, point.time), point.position);
        let point = MediumPoint { position, ..*point }.without_surface(scene);
        let context = ShadingContext { prepared: self, scene, graph, point: &point, assumed, probes: None };
        values.resize(2 * graph.nodes.len(), Vec4::ZERO);
        let (own, scratch) = values.split_at_mut(graph.nodes.len());
        shade_medium(&context, root, context.instance().density_factor, own, scratch, medium);
    }

    /// World-space position where grids have what velocities have brought to `position`.
    fn before_moving(&self, scene: &Scene, (instance, time): (u32, f32), position: Vec3) -> Vec3 {
        let placed = scene.instances.get(instance as usize);
        let moving = placed.and_then(|placed| {
            let set = placed.grids?;
            Some((placed, &scene.grids[set], self.fields.velocities(set)?))
        });
        let Some((placed, set, velocities)) = moving else { return position };
        let in_object = self.object_from_world(instance, time).transform_point3(position);
        let source = velocities.source(set, in_object, time);
        placed.world_from_object_at(time).transform_point3(source)
    }

    /// Wavelength of a path in nm for a number in 0..1; nothing where all paths are white.
    pub(crate) fn wavelength(&self, u: impl FnOnce() -> f32) -> Option<f32> {
        self.disperses.then(|| sample_wavelength(u()))
    }

    /// Graph of a material.
    pub(crate) fn graph(&self, material: usize) -> &Graph {
        &self.graphs[material]
    }

    /// Value at a world-space position of the grid with this name number that an instance has; nothing if it has none. A scalar is in
    /// all of red, green and blue.
    pub(crate) fn field(
        &self,
        scene: &Scene,
        (instance, time): (u32, f32),
        name: usize,
        position: Vec3,
    ) -> Option<Vec4> {
        let set = scene.instances.get(instance as usize)?.grids?;
        let position = self.object_from_world(instance, time).transform_point3(position);
        self.fields.value(scene, set, name, position)
    }

    /// The grid with this name number that an instance has.
    pub(crate) fn grid<'a>(&self, scene: &'a Scene, instance: u32, name: usize) -> Option<&'a Grid> {
        self.fields.grid(scene, scene.instances.get(instance as usize)?.grids?, name)
    }

    /// A texture of the world, white without one, in the unit `direction` of its space.
    pub fn world_texel(&self, scene: &Scene, texture: Option<usize>, direction: Vec3) -> Vec3 {
        let Some(index) = texture else { return Vec3::ONE };
        let uv = equirectangular(direction);
        let texture = &scene.textures[index];
        self.textures[index].sample(texture, uv, Interpolation::Linear, Extension::Repeat, false).truncate()
    }

    /// Scene-linear colour of the texel of an image at `uv`.
    pub(crate) fn texel(&self, scene: &Scene, texture: usize, uv: [f32; 2]) -> Vec3 {
        let image = &scene.textures[texture];
        self.textures[texture].sample(image, uv, Interpolation::Closest, Extension::Repeat, false).truncate()
    }

    fn attributes(&self, geometry: Geometry) -> &Attributes {
        match geometry {
            Geometry::Mesh(index) => &self.meshes[index].attributes,
            Geometry::Curves(index) => &self.curves[index],
            Geometry::Points(index) => &self.points[index],
        }
    }

    /// Lower corner and size of the box of a mesh's generated coordinates; nothing for other geometry.
    pub(super) fn bounds(&self, geometry: Geometry) -> Option<(Vec3, Vec3)> {
        let Geometry::Mesh(index) = geometry else { return None };
        Some(self.meshes[index].bounds)
    }

    /// Index of the UV map with this name number in a geometry.
    pub(super) fn uv_map(&self, geometry: Geometry, name: usize) -> Option<usize> {
        self.attributes(geometry).uv_maps[name]
    }

    /// Coordinates of a point in the UV map that renders use; nothing where its geometry has none.
    pub fn rendered_uv(&self, scene: &Scene, point: &SurfacePoint) -> Option<Vec2> {
        self.uv_map(point.geometry, 0)?;
        let graph = Graph::default();
        let context =
            ShadingContext { prepared: self, scene, graph: &graph, point, assumed: &[], probes: None };
        Some(context.active_uv().truncate())
    }

    /// The attribute with this name number in a geometry.
    pub(super) fn attribute(&self, geometry: Geometry, name: usize) -> Option<NamedAttribute> {
        self.attributes(geometry).named[name]
    }

    /// The attribute with this name number of an instance itself.
    pub(super) fn attribute_of_object(&self, instance: u32, name: usize) -> Option<Vec4> {
        self.of_objects.get(instance as usize)?.get(name).copied().flatten()
    }

    /// Corner tangents of the UV map with this name number.
    pub(super) fn tangents(&self, geometry: Geometry, name: usize, base: SurfaceBase) -> Option<&[Vec4]> {
        let Attributes { tangents, undisplaced_tangents, .. } = self.attributes(geometry);
        let before = undisplaced_tangents.get(name).filter(|_| base != SurfaceBase::Shaded);
        before.unwrap_or(&tangents[name]).as_deref()
    }
}

impl PreparedMesh {
    fn new(mesh: &Mesh, names: &Names) -> Self {
        Self {
            bounds: bounds(mesh),
            attributes: find_attributes(mesh, names),
            key_normals: key_normals(mesh),
        }
    }
}

/// Lower corner and size of the box of generated coordinates. Of a mesh that lies in the box's middle plane the size is 0:
/// its points are in the middle, whatever their position was rounded to.
fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    let positions = undisplaced_positions(mesh);
    let min = positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let max = positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    let Some([center, half]) = mesh.texture_space else { return (min, max - min) };
    let in_middle = min.cmpeq(center) & max.cmpeq(center);
    (center - half, Vec3::select(in_middle, Vec3::ZERO, half * 2.0))
}

/// Number of the UV map of each name; the empty name is the first one.
fn find_uv_maps(maps: &[UvMap], names: &Names) -> Vec<Option<usize>> {
    names.uv_maps.iter().map(|name| find(name, maps.iter().map(|map| &map.name))).collect()
}

fn find<'a>(name: &str, known: impl Iterator<Item = &'a String>) -> Option<usize> {
    let mut known = known.peekable();
    if name.is_empty() { known.peek().map(|_| 0) } else { known.position(|other| other.as_str() == name) }
}

fn find_color(name: &str, attributes: &[ColorAttribute]) -> Option<usize> {
    find(name, attributes.iter().map(|attribute| &attribute.name))
}

fn find_named_uv(name: &str, maps: &[UvMap]) -> Option<NamedAttribute> {
    maps.iter().position(|map| map.name == *name).map(NamedAttribute::Uv)
}

fn attributes_of_object(instance: &Instance, names: &Names) -> Vec<Option<Vec4>> {
    if instance.attributes.is_empty() {
        return Vec::new();
    }
    let value = |name: &String| {
        instance.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| Vec4::from(*value))
    };
    names.attributes.iter().map(value).collect()
}

/// Finds the attributes of curves; UV maps of strands have no tangents.
fn attributes_of_curves(curves: &Curves, names: &Names) -> Attributes {
    let named = names.attributes.iter().map(|name| {
        find_color(name, &curves.key_attributes)
            .map(NamedAttribute::Color)
            .or_else(|| find_color(name, &curves.curve_attributes).map(NamedAttribute::Curve))
            .or_else(|| find_named_uv(name, &curves.uv_maps))
    });
    let tangents = vec![None; names.uv_maps.len()];
    Attributes {
        uv_maps: find_uv_maps(&curves.uv_maps, names),
        tangents,
        undisplaced_tangents: Vec::new(),
        named: named.collect(),
    }
}

fn attributes_of_points(points: &Points, names: &Names) -> Attributes {
    let named = names.attributes.iter().map(|name| {
        find_color(name, &points.attributes)
            .map(NamedAttribute::Color)
            .or_else(|| find_named_uv(name, &points.uv_maps))
    });
    let tangents = vec![None; names.uv_maps.len()];
    Attributes {
        uv_maps: find_uv_maps(&points.uv_maps, names),
        tangents,
        undisplaced_tangents: Vec::new(),
        named: named.collect(),
    }
}

/// Finds named attributes of a mesh.
fn find_attributes(mesh: &Mesh, names: &Names) -> Attributes {
    let uv_maps = find_uv_maps(&mesh.uv_maps, names);
    let tangents = |positions: &[Vec3], normals: &[Vec3]| {
        let tangents = |(number, map): (usize, &Option<usize>)| {
            if !names.tangents.contains(&number) {
                return None;
            }
            let of_coords = |coords: &[Vec2]| corner_tangents(&mesh.triangles, positions, normals, coords);
            match map {
                Some(map) => Some(of_coords(&mesh.uv_maps[*map].coords)),
                None if names.uv_maps[number].is_empty() => {
                    let (min, size) = bounds(mesh);
                    Some(of_coords(&spherical_coords(mesh, min, size)))
                }
                None => None,
            }
        };
        uv_maps.iter().enumerate().map(tangents).collect::<Vec<_>>()
    };
    let undisplaced_tangents =
        mesh.undisplaced.as_ref().map(|before| tangents(&before.positions, &before.corner_normals));
    let tangents = tangents(&mesh.positions, &mesh.corner_normals);
    let named = names.attributes.iter().map(|name| {
        let color = find_color(name, &mesh.color_attributes).map(NamedAttribute::Color);
        color.or_else(|| find_named_uv(name, &mesh.uv_maps))
    });
    Attributes {
        tangents,
        undisplaced_tangents: undisplaced_tangents.unwrap_or_default(),
        named: named.collect(),
        uv_maps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_meshes_lie_in_the_middle_of_their_texture_space() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let texture_space = Some([Vec3::new(0.0, 0.5, 0.0), Vec3::new(2.0, 0.5, 1.0)]);
        let mesh = Mesh { positions, texture_space, ..Mesh::default() };
        assert_eq!(bounds(&mesh), (Vec3::new(-2.0, 0.0, -1.0), Vec3::new(4.0, 1.0, 0.0)));
        let boxed = Mesh { texture_space: None, ..mesh };
        assert_eq!(bounds(&boxed), (Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)));
    }
}
