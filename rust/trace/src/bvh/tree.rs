//! Layout of the wide tree: nodes of eight boxes and blocks of eight triangles, both structure-of-arrays, so that
//! one instruction tests a ray against all eight.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Vec3};
use relume_scene::{Pose, blend};

use super::{
    spheres::SphereBlock,
    storage::Storage,
    strands::{StrandBlock, StrandSet},
};

/// Children of a node and triangles of a block.
pub(super) const WIDTH: usize = 8;

/// Eight values, one a child or triangle, aligned for one vector load.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct BvhLanes(pub [f32; WIDTH]);

/// Reference in a slot of a node or an entry of the traversal stack: two bits of kind, thirty of index; the last kind
/// has two bits more of kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Child(pub u32);

/// Largest index that a [`Child`] holds.
pub(super) const INDEX_LIMIT: usize = 1 << 30;

/// Number of blocks of strands or spheres that a [`Child`] can tell apart.
pub(super) const SMALL_INDEX_LIMIT: usize = 1 << 28;

/// A decoded [`Child`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ChildKind {
    /// Index into [`Tree::nodes`].
    Node(usize),
    /// Index into [`Tree::blocks`].
    Block(usize),
    /// Index into [`Tree::placements`].
    Placement(usize),
    /// Back from an instance to the world; only on the stack.
    Leave,
    /// Index into [`Tree::strand_blocks`].
    Strands(usize),
    /// Index into [`Tree::sphere_blocks`].
    Spheres(usize),
    /// Index into [`Tree::blocks`] of a block whose triangles move to where the next one has them.
    MovingBlock(usize),
}

impl Child {
    /// Marks the way back from an instance on the stack.
    pub const LEAVE: Self = Self(3 << 30);

    pub fn node(index: usize) -> Self {
        Self(index as u32)
    }

    pub fn block(index: usize) -> Self {
        Self(index as u32 | 1 << 30)
    }

    pub fn strands(index: usize) -> Self {
        Self(index as u32 | 3 << 30 | 1 << 28)
    }

    pub fn spheres(index: usize) -> Self {
        Self(index as u32 | 3 << 30 | 2 << 28)
    }

    pub fn moving_block(index: usize) -> Self {
        Self(index as u32 | 3 << 30 | 3 << 28)
    }

    pub fn placement(index: usize) -> Self {
        Self(index as u32 | 2 << 30)
    }

    #[inline(always)]
    pub fn kind(self) -> ChildKind {
        let index = (self.0 & (INDEX_LIMIT as u32 - 1)) as usize;
        match self.0 >> 30 {
            0 => ChildKind::Node(index),
            1 => ChildKind::Block(index),
            2 => ChildKind::Placement(index),
            _ => {
                let small = index & (SMALL_INDEX_LIMIT - 1);
                match self.0 >> 28 & 3 {
                    0 => ChildKind::Leave,
                    1 => ChildKind::Strands(small),
                    2 => ChildKind::Spheres(small),
                    _ => ChildKind::MovingBlock(small),
                }
            }
        }
    }
}

/// Up to eight children. Empty slots have an inverted, infinite box that no ray enters.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct BvhNode {
    /// min x, min y, min z, max x, max y, max z of each child.
    pub planes: [BvhLanes; 6],
    pub children: [Child; WIDTH],
}

impl BvhNode {
    pub fn empty() -> Self {
        let (min, max) = (BvhLanes([f32::INFINITY; WIDTH]), BvhLanes([f32::NEG_INFINITY; WIDTH]));
        Self { planes: [min, min, min, max, max, max], children: [Child::LEAVE; WIDTH] }
    }

    pub fn set(&mut self, slot: usize, min: Vec3, max: Vec3, child: Child) {
        for axis in 0..3 {
            self.planes[axis].0[slot] = min[axis];
            self.planes[axis + 3].0[slot] = max[axis];
        }
        self.children[slot] = child;
    }
}

/// Up to eight triangles. Empty lanes have edges of length zero, which no ray hits.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct TriangleBlock {
    /// First corner: x, y, z.
    pub corner: [BvhLanes; 3],
    /// Edge from the first to the second corner.
    pub edge_1: [BvhLanes; 3],
    /// Edge from the first to the third corner.
    pub edge_2: [BvhLanes; 3],
    /// Length of the longer of the two edges.
    pub reach: BvhLanes,
    /// Number of the triangle: [`Tree::first_ids`] of its instance plus its index in the mesh in world space, the
    /// index in the mesh alone in object space.
    pub ids: [u32; WIDTH],
}

impl TriangleBlock {
    pub fn empty() -> Self {
        let zero = [BvhLanes([0.0; WIDTH]); 3];
        Self { corner: zero, edge_1: zero, edge_2: zero, reach: zero[0], ids: [u32::MAX; WIDTH] }
    }

    pub fn set(&mut self, lane: usize, [a, b, c]: [Vec3; 3], id: u32) {
        for axis in 0..3 {
            self.corner[axis].0[lane] = a[axis];
            self.edge_1[axis].0[lane] = b[axis] - a[axis];
            self.edge_2[axis].0[lane] = c[axis] - a[axis];
        }
        self.reach.0[lane] = (b - a).length().max((c - a).length());
        self.ids[lane] = id;
    }

    /// The block on its way to a later one of the same triangles.
    pub fn on_way(&self, later: &Self, share: f32) -> Self {
        let between = |a: &BvhLanes, b: &BvhLanes| {
            BvhLanes(std::array::from_fn(|lane| blend(a.0[lane], b.0[lane], share)))
        };
        let vectors =
            |a: &[BvhLanes; 3], b: &[BvhLanes; 3]| std::array::from_fn(|axis| between(&a[axis], &b[axis]));
        Self {
            corner: vectors(&self.corner, &later.corner),
            edge_1: vectors(&self.edge_1, &later.edge_1),
            edge_2: vectors(&self.edge_2, &later.edge_2),
            reach: between(&self.reach, &later.reach),
            ids: self.ids,
        }
    }

    /// Normal of a triangle, twice as long as its area.
    pub fn cross(&self, lane: usize) -> Vec3 {
        let vector = |lanes: &[BvhLanes; 3]| Vec3::new(lanes[0].0[lane], lanes[1].0[lane], lanes[2].0[lane]);
        vector(&self.edge_1).cross(vector(&self.edge_2))
    }
}

/// Geometry that stands in the world by reference: meshes that several instances share, strands and points, whose
/// radii have a meaning in object space alone, and all that moves, in pieces by time.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    pub object_from_world: Affine3A,
    /// Root of the geometry's own tree.
    pub root: Child,
    pub kind: PlacedKind,
    /// Index into [`relume_scene::Scene::instances`].
    pub instance: u32,
    /// Nothing if it stands still.
    pub motion: Option<PlacedMotion>,
}

/// Motion of a [`Placement`], which is there for a part of the time.
#[derive(Clone, Debug)]
pub(super) struct PlacedMotion {
    /// Time from which on it is there.
    pub from: f32,
    /// Time at which it is gone.
    pub to: f32,
    /// Keys of the instance's transform; empty if that keeps still.
    pub poses: Arc<[Pose]>,
    /// Intervals between keys of the shape, and which of them its tree is for.
    pub shape: (f32, f32),
}

impl Placement {
    /// True if it is there at a time.
    #[inline(always)]
    pub fn is_at(&self, time: f32) -> bool {
        self.motion.as_ref().is_none_or(|motion| motion.from <= time && time < motion.to)
    }

    /// The inverse of its transform at a time. It is not finite where it is scaled to nothing.
    #[inline(always)]
    pub fn object_from_world_at(&self, time: f32) -> Affine3A {
        match &self.motion {
            Some(motion) if !motion.poses.is_empty() => Pose::at(&motion.poses, time).inverse(),
            _ => self.object_from_world,
        }
    }

    /// How far its shape is at a time on the way from one key to the next.
    pub fn share_at(&self, time: f32) -> f32 {
        self.motion.as_ref().map_or(0.0, |motion| time * motion.shape.0 - motion.shape.1)
    }
}

/// Kind of the geometry of a [`Placement`].
#[derive(Clone, Copy, Debug)]
pub(super) enum PlacedKind {
    Mesh,
    MovingMesh,
    /// Index into [`Tree::strand_sets`].
    Strands(u32),
    Points,
    MovingPoints,
}

/// Trees while they are built.
#[derive(Debug, Default)]
pub(super) struct Growing {
    pub nodes: Vec<BvhNode>,
    pub blocks: Vec<TriangleBlock>,
    pub strand_blocks: Vec<StrandBlock>,
    pub strand_sets: Vec<StrandSet>,
    pub sphere_blocks: Vec<SphereBlock>,
    pub placements: Vec<Placement>,
}

/// All trees of a scene in one pool: the world's, and one for each geometry that is placed.
#[derive(Debug, Default)]
pub(super) struct Tree {
    pub nodes: Storage<BvhNode>,
    pub blocks: Storage<TriangleBlock>,
    pub strand_blocks: Storage<StrandBlock>,
    pub strand_sets: Vec<StrandSet>,
    pub sphere_blocks: Storage<SphereBlock>,
    pub placements: Vec<Placement>,
    /// Root of the world's tree; none if there is nothing to hit.
    pub root: Option<Child>,
    /// Number of the first triangle of each instance whose triangles are in the world's tree.
    pub first_ids: Vec<u32>,
    /// Instance of each triangle number.
    pub instance_of: Vec<u32>,
    /// Most entries that traversal pushes on its stack.
    pub stack_depth: usize,
}

impl Tree {
    /// A moving block of a placement at a time.
    pub fn moving_block(&self, index: usize, placement: &Placement, time: f32) -> TriangleBlock {
        self.blocks[index].on_way(&self.blocks[index + 1], placement.share_at(time))
    }

    /// A moving block of spheres of a placement at a time.
    pub fn moving_spheres(&self, index: usize, placement: &Placement, time: f32) -> SphereBlock {
        self.sphere_blocks[index].on_way(&self.sphere_blocks[index + 1], placement.share_at(time))
    }

    /// Memory that it takes.
    pub fn bytes(&self) -> usize {
        let sets: usize = self.strand_sets.iter().map(StrandSet::bytes).sum();
        size_of_val(&*self.nodes)
            + size_of_val(&*self.blocks)
            + size_of_val(&*self.strand_blocks)
            + size_of_val(&*self.sphere_blocks)
            + size_of_val(&*self.placements)
            + size_of_val(&*self.first_ids)
            + size_of_val(&*self.instance_of)
            + sets
    }
}
