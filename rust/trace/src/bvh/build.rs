//! Builds the trees of a scene: obvhs makes a binary tree, [`super::collapse`] makes it wide.

use glam::{Affine3A, Vec3, Vec3A};
use obvhs::{
    aabb::Aabb,
    bvh2::{Bvh2, reinsertion::ReinsertionOptimizer},
    ploc::{PlocBuilder, PlocSearchDistance, SortPrecision},
    splits::split_aabbs_preset,
    triangle::Triangle,
};
use relume_scene::{Geometry, Instance, Mesh, Scene};

use super::{
    BvhError,
    collapse::{Primitives, collapse},
    storage::Storage,
    tree::{Child, Growing, INDEX_LIMIT, MeshPlacement, Tree},
};

/// Share of the nodes that obvhs tries to reinsert at better places. Twenty times as many cost twenty times the time and
/// save one ray in a hundred; none would cost one in ten.
const REINSERTION_RATIO: f32 = 0.05;

/// Meshes that several instances share get a tree of their own if they have at least this many triangles; smaller
/// ones are copied into the world, since entering an instance costs about as much as two node tests.
pub(super) const SHARED_MESH_TRIANGLES: usize = 64;

/// Builds all trees of `scene`.
pub(super) fn build(scene: &Scene) -> Result<Tree, BvhError> {
    let mut uses = vec![0_usize; scene.meshes.len()];
    for instance in &scene.instances {
        let Geometry::Mesh(mesh) = instance.geometry;
        uses[mesh] += 1;
    }
    let is_shared =
        |mesh: usize| uses[mesh] > 1 && scene.meshes[mesh].triangles.len() >= SHARED_MESH_TRIANGLES;

    let mut tree = Growing::default();
    let (mut first_ids, mut instance_of) = (Vec::new(), Vec::new());
    let mut world = PrimitiveList::default();
    let mut shared_roots = vec![None; scene.meshes.len()];
    let mut depth_below = 0;
    for (index, instance) in scene.instances.iter().enumerate() {
        let Geometry::Mesh(number) = instance.geometry;
        let mesh = &scene.meshes[number];
        first_ids.push(instance_of.len() as u32);
        if is_shared(number) {
            if shared_roots[number].is_none() {
                let mut list = PrimitiveList::default();
                list.add_mesh(mesh, Affine3A::IDENTITY, 0);
                let root = list.build(&mut tree);
                depth_below = depth_below.max(root.map_or(0, |(_, depth)| depth));
                shared_roots[number] = Some((root, list.bounds()));
            }
            if let Some((Some((root, _)), bounds)) = shared_roots[number] {
                world.add_placement(instance, index, root, bounds, &mut tree);
            }
        } else {
            world.add_mesh(mesh, instance.world_from_object, instance_of.len() as u32);
            instance_of.resize(instance_of.len() + mesh.triangles.len(), index as u32);
        }
        if instance_of.len() >= INDEX_LIMIT {
            return Err(BvhError::TooManyTriangles { limit: INDEX_LIMIT });
        }
    }
    let root = world.build(&mut tree);
    Ok(Tree {
        nodes: Storage::new(tree.nodes),
        blocks: Storage::new(tree.blocks),
        placements: tree.placements,
        root: root.map(|(root, _)| root),
        first_ids,
        instance_of,
        // One entry more for the way back from an instance.
        stack_depth: root.map_or(0, |(_, depth)| depth) + depth_below + 1,
    })
}

/// Primitives of one binary tree: triangles first, then placements.
#[derive(Default)]
struct PrimitiveList {
    triangles: Vec<Triangle>,
    ids: Vec<u32>,
    placements: Vec<(Aabb, Child)>,
}

impl PrimitiveList {
    /// Adds the triangles that have an area; the others can be met by no ray.
    fn add_mesh(&mut self, mesh: &Mesh, world_from_object: Affine3A, first_id: u32) {
        self.triangles.reserve(mesh.triangles.len());
        self.ids.reserve(mesh.triangles.len());
        for (index, triangle) in mesh.triangles.iter().enumerate() {
            let [v0, v1, v2] = triangle.map(|vertex| {
                world_from_object.transform_point3a(Vec3A::from(mesh.positions[vertex as usize]))
            });
            let area = (v1 - v0).cross(v2 - v0).length_squared();
            if area > 0.0 && area.is_finite() {
                self.triangles.push(Triangle { v0, v1, v2 });
                self.ids.push(first_id + index as u32);
            }
        }
    }

    fn add_placement(
        &mut self,
        instance: &Instance,
        index: usize,
        root: Child,
        bounds: Aabb,
        tree: &mut Growing,
    ) {
        let object_from_world = instance.world_from_object.inverse();
        if !object_from_world.is_finite() {
            return;
        }
        let mut world = Aabb::INVALID;
        for corner in 0..8 {
            let pick =
                |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
            world.extend(instance.world_from_object.transform_point3a(Vec3A::new(pick(0), pick(1), pick(2))));
        }
        // The transform of the ray rounds, so that the box has to be a little larger.
        let slack = world.min.abs().max(world.max.abs()) * (4.0 * f32::EPSILON);
        let world = Aabb { min: world.min - slack, max: world.max + slack };
        tree.placements.push(MeshPlacement { object_from_world, root, instance: index as u32 });
        self.placements.push((world, Child::placement(tree.placements.len() - 1)));
    }

    fn bounds(&self) -> Aabb {
        self.triangles.iter().fold(Aabb::INVALID, |bounds, triangle| bounds.union(&triangle.aabb()))
    }

    fn build(&self, tree: &mut Growing) -> Option<(Child, usize)> {
        let mut binary = self.build_binary()?;
        collapse(&mut binary, self, tree)
    }

    /// obvhs's steps of a slow, good build, with a primitive a leaf: large triangles are split, then PLOC, then
    /// reinsertion.
    fn build_binary(&self) -> Option<Bvh2> {
        let mut bounds: Vec<Aabb> = self.triangles.iter().map(Triangle::aabb).collect();
        let mut indices: Vec<u32> = (0..bounds.len() as u32).collect();
        if !bounds.is_empty() {
            let areas = || bounds.iter().map(Aabb::half_area);
            let largest = areas().fold(0.0, f32::max);
            let mean = areas().map(f64::from).sum::<f64>() / bounds.len() as f64;
            split_aabbs_preset(&mut bounds, &mut indices, &self.triangles, mean as f32, largest);
        }
        for (index, (placement, _)) in self.placements.iter().enumerate() {
            bounds.push(*placement);
            indices.push((self.triangles.len() + index) as u32);
        }
        if bounds.is_empty() {
            return None;
        }
        let mut binary = PlocBuilder::with_capacity(bounds.len()).build(
            PlocSearchDistance::High,
            &bounds,
            indices,
            SortPrecision::U128,
            2,
        );
        binary.uses_spatial_splits = true;
        ReinsertionOptimizer::default().run(&mut binary, REINSERTION_RATIO, None);
        Some(binary)
    }
}

impl Primitives for PrimitiveList {
    fn triangle(&self, primitive: u32) -> Option<([Vec3; 3], u32)> {
        let triangle = self.triangles.get(primitive as usize)?;
        let corners = [triangle.v0, triangle.v1, triangle.v2].map(Vec3::from);
        Some((corners, self.ids[primitive as usize]))
    }

    fn placement(&self, primitive: u32) -> Child {
        self.placements[primitive as usize - self.triangles.len()].1
    }
}
