//! Builds the trees of a scene: obvhs makes a binary tree, [`super::collapse`] makes it wide.

mod motion;

use std::collections::{HashMap, hash_map::Entry};

use glam::{Affine3A, Vec3, Vec3A};
use obvhs::{
    aabb::Aabb,
    bvh2::{Bvh2, reinsertion::ReinsertionOptimizer},
    ploc::{PlocBuilder, PlocSearchDistance, SortPrecision},
    splits::split_aabbs_preset,
    triangle::Triangle,
};
use relume_scene::{Curves, Geometry, Instance, Material, Mesh, Points, Scene};

use super::{
    BvhError,
    collapse::{Primitives, collapse},
    spheres::SphereBlock,
    storage::Storage,
    strands::{KEY_LIMIT, Piece, StrandBlock, StrandSet},
    tree::{Child, Growing, INDEX_LIMIT, PlacedKind, Placement, Tree, TriangleBlock},
};

/// Share of the nodes that obvhs tries to reinsert at better places. Twenty times as many cost twenty times the time and
/// save one ray in a hundred; none would cost one in ten.
const REINSERTION_RATIO: f32 = 0.05;

/// Meshes that several instances share get a tree of their own if they have at least this many triangles; smaller
/// ones are copied into the world, since entering an instance costs about as much as two node tests.
pub(super) const SHARED_MESH_TRIANGLES: usize = 64;

/// Builds all trees of `scene`. Meshes that rays look for alone have a tree of their own, which
/// [`super::SceneBvh::intersect_within`] walks.
pub(super) fn build(scene: &Scene) -> Result<Tree, BvhError> {
    let mut uses = vec![0_usize; scene.meshes.len()];
    let mut is_body = vec![false; scene.meshes.len()];
    let is_alone: Vec<bool> = scene.materials.iter().map(Material::meets_itself).collect();
    for instance in &scene.instances {
        if let Geometry::Mesh(mesh) = instance.geometry {
            uses[mesh] += 1;
            is_body[mesh] |= instance.materials.iter().any(|m| is_alone.get(*m) == Some(&true));
        }
    }
    let in_world = |mesh: usize| !is_body[mesh] && (uses[mesh] == 1 || is_small(&scene.meshes[mesh]));

    let mut tree = Growing::default();
    let (mut first_ids, mut instance_of) = (Vec::new(), Vec::new());
    let mut world = PrimitiveList::default();
    let mut roots: HashMap<Geometry, Vec<Option<OwnTree>>> = HashMap::new();
    for (index, instance) in scene.instances.iter().enumerate() {
        first_ids.push(instance_of.len() as u32);
        match instance.geometry {
            Geometry::Mesh(mesh) if in_world(mesh) && !motion::moves(scene, instance) => {
                let mesh = &scene.meshes[mesh];
                world.add_mesh(mesh, instance.world_from_object, instance_of.len() as u32);
                instance_of.resize(instance_of.len() + mesh.triangles.len(), index as u32);
                if instance_of.len() >= INDEX_LIMIT {
                    return Err(BvhError::TooManyTriangles { limit: INDEX_LIMIT });
                }
            }
            geometry => {
                let own: &[Option<OwnTree>] = match roots.entry(geometry) {
                    Entry::Occupied(known) => known.into_mut(),
                    Entry::Vacant(new) => new.insert(own_trees(scene, geometry, &mut tree)?),
                };
                if let [Some(own)] = own
                    && instance.motion.is_empty()
                {
                    world.add_placement(instance, index, own, &mut tree);
                } else {
                    world.add_moving(instance, index, own, &mut tree);
                }
            }
        }
    }
    let root = world.build(&mut tree);
    let depth_below = roots.values().flatten().flatten().map(|root| root.depth).max().unwrap_or(0);
    Ok(Tree {
        nodes: Storage::new(tree.nodes),
        blocks: Storage::new(tree.blocks),
        strand_blocks: Storage::new(tree.strand_blocks),
        strand_sets: tree.strand_sets,
        sphere_blocks: Storage::new(tree.sphere_blocks),
        placements: tree.placements,
        root: root.map(|(root, _)| root),
        first_ids,
        instance_of,
        // One entry more for the way back from an instance.
        stack_depth: root.map_or(0, |(_, depth)| depth) + depth_below + 1,
    })
}

fn is_small(mesh: &Mesh) -> bool {
    mesh.triangles.len() < SHARED_MESH_TRIANGLES
}

/// The trees of a geometry: one, or one for each interval between the keys of its shape. Nothing if rays cannot meet it.
fn own_trees(
    scene: &Scene,
    geometry: Geometry,
    tree: &mut Growing,
) -> Result<Vec<Option<OwnTree>>, BvhError> {
    let keys = scene.shape_keys(geometry);
    if keys == 0 {
        return Ok(vec![OwnTree::build(scene, geometry, tree)?]);
    }
    (0..keys - 1).map(|key| motion::own_tree(scene, geometry, key, tree)).collect()
}

/// Box of a geometry, root and depth of its tree, and its kind.
type Built = (Aabb, Option<(Child, usize)>, PlacedKind);

/// Tree of a geometry that is placed.
#[derive(Clone, Copy)]
struct OwnTree {
    root: Child,
    kind: PlacedKind,
    bounds: Aabb,
    /// Depth of its stack.
    depth: usize,
}

impl OwnTree {
    /// The tree of a geometry; nothing if rays cannot meet it.
    fn build(scene: &Scene, geometry: Geometry, tree: &mut Growing) -> Result<Option<Self>, BvhError> {
        let (bounds, built, kind) = match geometry {
            Geometry::Mesh(mesh) => {
                let mut list = PrimitiveList::default();
                list.add_mesh(&scene.meshes[mesh], Affine3A::IDENTITY, 0);
                (list.bounds(), list.build(tree), PlacedKind::Mesh)
            }
            Geometry::Curves(curves) => {
                let list = StrandList::new(&scene.curves[curves], StrandSet::new)?;
                list.build(tree)
            }
            Geometry::Points(points) => {
                let list = SphereList::new(&scene.points[points]);
                let boxes: Vec<Aabb> = list.boxes().collect();
                (union(boxes.iter().copied()), build_boxes(&list, boxes, tree), PlacedKind::Points)
            }
        };
        Ok(Self::of((bounds, built, kind)))
    }

    fn of((bounds, built, kind): Built) -> Option<Self> {
        built.map(|(root, depth)| Self { root, kind, bounds, depth })
    }
}

/// The transform of the ray rounds, so that a box has to be a little larger.
fn widened(bounds: Aabb) -> Aabb {
    let slack = bounds.min.abs().max(bounds.max.abs()) * (4.0 * f32::EPSILON);
    Aabb { min: bounds.min - slack, max: bounds.max + slack }
}

fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::INVALID, |bounds, other| bounds.union(&other))
}

fn piece_box(piece: &Piece) -> Aabb {
    Aabb { min: piece.min.into(), max: piece.max.into() }
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

    fn add_placement(&mut self, instance: &Instance, index: usize, placed: &OwnTree, tree: &mut Growing) {
        let object_from_world = instance.world_from_object.inverse();
        if !object_from_world.is_finite() {
            return;
        }
        let (bounds, mut world) = (placed.bounds, Aabb::INVALID);
        for corner in 0..8 {
            let pick =
                |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
            world.extend(instance.world_from_object.transform_point3a(Vec3A::new(pick(0), pick(1), pick(2))));
        }
        let world = widened(world);
        let OwnTree { root, kind, .. } = *placed;
        tree.placements.push(Placement {
            object_from_world,
            root,
            kind,
            instance: index as u32,
            motion: None,
        });
        self.placements.push((world, Child::placement(tree.placements.len() - 1)));
    }

    fn bounds(&self) -> Aabb {
        union(self.triangles.iter().map(Triangle::aabb))
    }

    /// obvhs's steps of a slow, good build, with a primitive a leaf: large triangles are split, then PLOC, then
    /// reinsertion.
    fn build(&self, tree: &mut Growing) -> Option<(Child, usize)> {
        let triangles = self.triangles.len();
        let mut bounds: Vec<Aabb> = self.triangles.iter().map(Triangle::aabb).collect();
        let mut indices: Vec<u32> = (0..bounds.len() as u32).collect();
        if !bounds.is_empty() {
            let areas = || bounds.iter().map(Aabb::half_area);
            let largest = areas().fold(0.0, f32::max);
            let mean = areas().map(f64::from).sum::<f64>() / bounds.len() as f64;
            split_aabbs_preset(&mut bounds, &mut indices, &self.triangles, mean as f32, largest);
        }
        // Leaves of obvhs hold numbers of primitives, and `primitive_indices` has to give each of them itself: parts of split
        // triangles come last.
        let (split_bounds, split_indices) = (bounds.split_off(triangles), indices.split_off(triangles));
        bounds.extend(self.placements.iter().map(|(placement, _)| *placement));
        indices.extend(triangles as u32..(triangles + self.placements.len()) as u32);
        bounds.extend(split_bounds);
        indices.extend(split_indices);
        collapse(&mut binary_tree(&bounds, indices)?, self, tree)
    }
}

/// Builds a tree with a box for each primitive.
fn build_boxes(list: &impl Primitives, boxes: Vec<Aabb>, tree: &mut Growing) -> Option<(Child, usize)> {
    let indices = (0..boxes.len() as u32).collect();
    let binary = binary_tree(&boxes, indices);
    // Their memory serves the wide tree.
    drop(boxes);
    collapse(&mut binary?, list, tree)
}

fn binary_tree(bounds: &[Aabb], indices: Vec<u32>) -> Option<Bvh2> {
    if bounds.is_empty() {
        return None;
    }
    let mut binary = PlocBuilder::with_capacity(bounds.len()).build(
        PlocSearchDistance::High,
        bounds,
        indices,
        SortPrecision::U128,
        2,
    );
    binary.uses_spatial_splits = true;
    ReinsertionOptimizer::default().run(&mut binary, REINSERTION_RATIO, None);
    Some(binary)
}

impl Primitives for PrimitiveList {
    const BLOCK_COST: f32 = 1.3;

    fn is_packed(&self, primitive: u32) -> bool {
        (primitive as usize) < self.triangles.len()
    }

    fn write_leaf(&self, primitives: &[u32], tree: &mut Growing) -> Child {
        if let Some(placement) = (primitives[0] as usize).checked_sub(self.triangles.len()) {
            return self.placements[placement].1;
        }
        let mut block = TriangleBlock::empty();
        for (lane, &primitive) in primitives.iter().enumerate() {
            let triangle = &self.triangles[primitive as usize];
            let corners = [triangle.v0, triangle.v1, triangle.v2].map(Vec3::from);
            block.set(lane, corners, self.ids[primitive as usize]);
        }
        tree.blocks.push(block);
        Child::block(tree.blocks.len() - 1)
    }
}

/// Pieces of the strands of one geometry.
struct StrandList {
    set: StrandSet,
    pieces: Vec<Piece>,
}

impl StrandList {
    fn new(curves: &Curves, set: impl FnOnce(&Curves) -> StrandSet) -> Result<Self, BvhError> {
        if curves.keys.len() >= KEY_LIMIT {
            return Err(BvhError::TooManyKeys { limit: KEY_LIMIT });
        }
        let set = set(curves);
        let pieces = set.pieces();
        Ok(Self { set, pieces })
    }

    fn build(self, tree: &mut Growing) -> Built {
        let number = tree.strand_sets.len() as u32;
        let bounds = union(self.pieces.iter().map(piece_box));
        let built = build_boxes(&self, self.pieces.iter().map(piece_box).collect(), tree);
        tree.strand_sets.push(self.set);
        (bounds, built, PlacedKind::Strands(number))
    }
}

impl Primitives for StrandList {
    /// Higher costs make emptier blocks, which are as quick within noise in a head of hair and take more memory.
    const BLOCK_COST: f32 = 1.0;

    fn is_packed(&self, _primitive: u32) -> bool {
        true
    }

    fn write_leaf(&self, primitives: &[u32], tree: &mut Growing) -> Child {
        let pieces = primitives.iter().map(|primitive| &self.pieces[*primitive as usize]);
        tree.strand_blocks.push(StrandBlock::new(pieces));
        Child::strands(tree.strand_blocks.len() - 1)
    }
}

/// Spheres of one geometry that have a radius, by their index.
struct SphereList<'a> {
    points: &'a Points,
    ids: Vec<u32>,
}

impl<'a> SphereList<'a> {
    fn new(points: &'a Points) -> Self {
        let ids = (0..points.radii.len() as u32).filter(|id| points.radii[*id as usize] > 0.0).collect();
        Self { points, ids }
    }

    fn boxes(&self) -> impl Iterator<Item = Aabb> {
        self.ids.iter().map(|&id| {
            let (center, radius) = (self.points.positions[id as usize], self.points.radii[id as usize]);
            let margin = radius + center.abs().max_element() * (4.0 * f32::EPSILON);
            Aabb { min: (center - margin).into(), max: (center + margin).into() }
        })
    }
}

impl Primitives for SphereList<'_> {
    const BLOCK_COST: f32 = 1.0;

    fn is_packed(&self, _primitive: u32) -> bool {
        true
    }

    fn write_leaf(&self, primitives: &[u32], tree: &mut Growing) -> Child {
        let mut block = SphereBlock::empty();
        for (lane, &primitive) in primitives.iter().enumerate() {
            let id = self.ids[primitive as usize];
            block.set(lane, self.points.positions[id as usize], self.points.radii[id as usize], id);
        }
        tree.sphere_blocks.push(block);
        Child::spheres(tree.sphere_blocks.len() - 1)
    }
}
