//! Walks the tree front to back with a stack sorted by distance. The arithmetic on eight lanes is a [`TraversalKernel`]:
//! AVX2 where the processor has it, plain Rust elsewhere.

use std::{cell::OnceCell, mem::MaybeUninit};

use glam::Vec3;

use super::{
    Ray,
    strands::{StrandBlock, StrandHit, StrandRay},
    tree::{BvhLanes, BvhNode, Child, ChildKind, PlacedKind, Tree, TriangleBlock, WIDTH},
};

/// Entries on the stack of traversal; deeper trees are walked with one on the heap.
pub(super) const STACK: usize = 256;

/// A ray as a kernel likes it, in world or object space; distances are the same in both.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalRay {
    pub origin: Vec3,
    pub direction: Vec3,
    /// Finite also where the direction is 0.
    pub inverse: Vec3,
    /// Plane of [`BvhNode::planes`] that the ray crosses first, for each axis.
    pub near: [usize; 3],
    pub far: [usize; 3],
}

impl LocalRay {
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let inverse = direction.map(|d| if d.abs() > 1e-18 { 1.0 / d } else { 1e18_f32.copysign(d) });
        let pick = |axis: usize| if inverse[axis] < 0.0 { axis + 3 } else { axis };
        let near = [pick(0), pick(1), pick(2)];
        let far = [3 - near[0], 5 - near[1], 7 - near[2]];
        Self { origin, direction, inverse, near, far }
    }
}

/// Lanes of a block that were hit.
pub(super) struct BlockHits {
    /// Bit per lane.
    pub mask: u32,
    pub t: BvhLanes,
    pub u: BvhLanes,
    pub v: BvhLanes,
}

/// Tests of one ray against eight boxes, triangles or strands.
pub(super) trait TraversalKernel: Copy {
    /// Spreads a ray over the lanes.
    fn new(ray: &LocalRay) -> Self;
    /// Bit per child whose box the ray is inside of within `t_min..=t_max`, and where it enters.
    fn enter(&self, ray: &LocalRay, node: &BvhNode, t_min: f32, t_max: f32) -> (u32, BvhLanes);
    /// Bit per strand that the ray may meet before `z_max`.
    fn near_strands(block: &StrandBlock, ray: &StrandRay, z_max: f32) -> u32;
    /// Triangles hit with `t_min < t < t_max`.
    fn hit(&self, block: &TriangleBlock, t_min: f32, t_max: f32) -> BlockHits;
}

/// Rounding moves a barycentric coordinate by up to about this times
/// `distance to the first corner * longer edge / |determinant|`; triangles are widened by it, so that no ray slips
/// between two neighbours.
pub(super) const EDGE_SLACK: f32 = 2.0 * f32::EPSILON;

/// Most by which a triangle is widened: at grazing incidence the bound above grows without limit.
pub(super) const MAX_EDGE_SLACK: f32 = 1e-3;

/// Boxes are left this much later than computed: three roundings of the slab test.
pub(super) const EXIT_SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;

/// The nearest hit so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearestHit {
    pub t: f32,
    pub u: f32,
    pub v: f32,
    pub id: u32,
    /// Index into [`Tree::blocks`], or that of strands or spheres.
    pub block: u32,
    pub lane: u32,
    /// Index into [`Tree::placements`]; `u32::MAX` in the world.
    pub placement: u32,
}

/// One entry of the stack: distance in the upper half, so that integers sort by distance.
#[inline(always)]
fn entry(t: f32, child: Child) -> u64 {
    u64::from(t.to_bits()) << 32 | u64::from(child.0)
}

/// Nearest hit below `root`, or the first one met if `ANY`. `accept(placement, id)` says whether a triangle or sphere
/// counts; `source(placement)` is the number of the primitive that the ray leaves, `u32::MAX` if it is elsewhere.
#[inline(always)]
pub(super) fn traverse<K: TraversalKernel, const ANY: bool>(
    tree: &Tree,
    ray: &Ray,
    root: Option<Child>,
    stack: &mut [MaybeUninit<u64>],
    accept: impl Fn(u32, u32) -> bool,
    enter_placement: impl Fn(u32) -> bool,
    source: impl Fn(u32) -> u32,
) -> Option<NearestHit> {
    let (nodes, blocks): (&[BvhNode], &[TriangleBlock]) = (&tree.nodes, &tree.blocks);
    let world = LocalRay::new(ray.origin, ray.direction);
    let world_kernel = K::new(&world);
    let (mut local, mut kernel) = (world, world_kernel);
    let mut found =
        NearestHit { t: ray.t_max, u: 0.0, v: 0.0, id: u32::MAX, block: 0, lane: 0, placement: u32::MAX };
    let mut placement = u32::MAX;
    // Only strands need it.
    let mut strand_ray: Option<StrandRay> = None;
    let mut top = 0;
    let mut current = root?;
    loop {
        match current.kind() {
            ChildKind::Node(index) => {
                let node = &nodes[index];
                let (mask, entries) = kernel.enter(&local, node, ray.t_min, found.t);
                if mask != 0 {
                    current = push_children(node, mask, &entries, stack, &mut top);
                    continue;
                }
            }
            ChildKind::Block(index) => {
                let hits = kernel.hit(&blocks[index], ray.t_min, found.t);
                if take_nearest::<ANY>(&hits, &blocks[index].ids, (index, placement), &mut found, &accept) {
                    return Some(found);
                }
            }
            ChildKind::Placement(index) => {
                let target = &tree.placements[index];
                if target.is_at(ray.time) && enter_placement(index as u32) {
                    stack[top].write(entry(0.0, Child::LEAVE));
                    top += 1;
                    let object_from_world = target.object_from_world_at(ray.time);
                    local = LocalRay::new(
                        object_from_world.transform_point3(ray.origin),
                        object_from_world.transform_vector3(ray.direction),
                    );
                    kernel = K::new(&local);
                    strand_ray = None;
                    placement = index as u32;
                    current = target.root;
                    continue;
                }
            }
            ChildKind::MovingBlock(index) => {
                let block = tree.moving_block(index, &tree.placements[placement as usize], ray.time);
                let hits = kernel.hit(&block, ray.t_min, found.t);
                if take_nearest::<ANY>(&hits, &block.ids, (index, placement), &mut found, &accept) {
                    return Some(found);
                }
            }
            ChildKind::Leave => {
                (local, kernel, placement) = (world, world_kernel, u32::MAX);
            }
            ChildKind::Strands(index) => {
                let strand_ray = strand_ray.get_or_insert_with(|| StrandRay::new(&local));
                let block = &tree.strand_blocks[index];
                let mask = K::near_strands(block, strand_ray, found.t * strand_ray.length);
                let target = &tree.placements[placement as usize];
                if mask != 0
                    && let PlacedKind::Strands(set) = target.kind
                    && let Some(hit) = tree.strand_sets[set as usize].hit(
                        block,
                        mask,
                        strand_ray,
                        (ray.t_min, found.t),
                        source(placement),
                        target.share_at(ray.time),
                    )
                {
                    let StrandHit { t, u, v, key: id } = hit;
                    found = NearestHit { t, u, v, id, block: index as u32, lane: 0, placement };
                    if ANY {
                        return Some(found);
                    }
                }
            }
            ChildKind::Spheres(index) => {
                let (moved, target) = (OnceCell::new(), &tree.placements[placement as usize]);
                let block = match target.kind {
                    PlacedKind::MovingPoints => {
                        moved.get_or_init(|| tree.moving_spheres(index, target, ray.time))
                    }
                    _ => &tree.sphere_blocks[index],
                };
                let entries = block.enter(&local);
                for (lane, &t) in entries.0.iter().enumerate() {
                    if t > ray.t_min && t < found.t && accept(placement, block.ids[lane]) {
                        let (id, lane) = (block.ids[lane], lane as u32);
                        found = NearestHit { t, u: 0.0, v: 0.0, id, block: index as u32, lane, placement };
                        if ANY {
                            return Some(found);
                        }
                    }
                }
            }
        }
        // The next entry that is still in reach.
        loop {
            if top == 0 {
                return (found.id != u32::MAX).then_some(found);
            }
            top -= 1;
            // SAFETY: entries below `top` were written by a push.
            let next = unsafe { stack[top].assume_init() };
            if f32::from_bits((next >> 32) as u32) < found.t {
                current = Child(next as u32);
                break;
            }
        }
    }
}

/// Keeps the nearest of a block's hits that counts; true if that ends the search.
#[inline(always)]
fn take_nearest<const ANY: bool>(
    hits: &BlockHits,
    ids: &[u32; WIDTH],
    (block, placement): (usize, u32),
    found: &mut NearestHit,
    accept: &impl Fn(u32, u32) -> bool,
) -> bool {
    let mut mask = hits.mask;
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        if hits.t.0[lane] < found.t && accept(placement, ids[lane]) {
            let [t, u, v] = [&hits.t, &hits.u, &hits.v].map(|lanes| lanes.0[lane]);
            let (id, block, lane) = (ids[lane], block as u32, lane as u32);
            *found = NearestHit { t, u, v, id, block, lane, placement };
            if ANY {
                return true;
            }
        }
    }
    false
}

/// Returns the nearest child and leaves the others on the stack, farthest first.
#[inline(always)]
fn push_children(
    node: &BvhNode,
    mut mask: u32,
    entries: &BvhLanes,
    stack: &mut [MaybeUninit<u64>],
    top: &mut usize,
) -> Child {
    let mut take = || {
        let lane = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        (entry(entries.0[lane], node.children[lane]), mask != 0)
    };
    let (mut nearest, mut more) = take();
    let base = *top;
    while more {
        let next;
        (next, more) = take();
        // Insertion sort: a node's few children, most of them already in place.
        let far = nearest.max(next);
        nearest = nearest.min(next);
        let mut slot = *top;
        while slot > base {
            // SAFETY: slots between `base` and `top` were written by this loop.
            let below = unsafe { stack[slot - 1].assume_init() };
            if below >= far {
                break;
            }
            stack[slot].write(below);
            slot -= 1;
        }
        stack[slot].write(far);
        *top += 1;
    }
    Child(nearest as u32)
}
