//! Trees of what moves: placements of a part of the time each, and blocks at both ends of an interval between keys.

use std::sync::Arc;

use glam::{Vec3, Vec4};
use obvhs::aabb::Aabb;
use relume_scene::{Geometry, Instance, Mesh, Pose, Scene};

use super::{OwnTree, PrimitiveList, StrandList, build_boxes, union, widened};
use crate::bvh::{
    BvhError,
    collapse::Primitives,
    spheres::SphereBlock,
    strands::StrandSet,
    tree::{Child, Growing, PlacedKind, PlacedMotion, Placement, TriangleBlock},
};

/// Rotation within one placement, radians. Boxes of more would hold much empty space.
const MOST_TURN: f32 = 0.3;
/// Way within one placement, in diagonals of the geometry's box.
const MOST_WAY: f32 = 0.5;
/// Placements for one interval between keys.
const MOST_PIECES: usize = 8;

/// True if an instance moves, or its shape does.
pub(super) fn moves(scene: &Scene, instance: &Instance) -> bool {
    !instance.motion.is_empty() || scene.shape_keys(instance.geometry) > 0
}

/// The tree of a geometry on its way from a key of its shape to the next.
pub(super) fn own_tree(
    scene: &Scene,
    geometry: Geometry,
    key: usize,
    tree: &mut Growing,
) -> Result<Option<OwnTree>, BvhError> {
    Ok(OwnTree::of(match geometry {
        Geometry::Mesh(mesh) => {
            let list = MovingTriangles::new(&scene.meshes[mesh], key);
            let boxes: Vec<Aabb> = list.boxes().collect();
            (union(boxes.iter().copied()), build_boxes(&list, boxes, tree), PlacedKind::MovingMesh)
        }
        Geometry::Curves(curves) => {
            StrandList::new(&scene.curves[curves], |curves| StrandSet::moving(curves, key))?.build(tree)
        }
        Geometry::Points(points) => {
            let (keys, count) = (&scene.points[points].motion, scene.points[points].positions.len());
            let at = |key: usize| &keys[key * count..(key + 1) * count];
            let list = MovingSpheres { ends: [at(key), at(key + 1)] };
            let boxes: Vec<Aabb> = list.boxes().collect();
            (union(boxes.iter().copied()), build_boxes(&list, boxes, tree), PlacedKind::MovingPoints)
        }
    }))
}

impl PrimitiveList {
    /// Places an instance that moves, or whose shape does: once for each piece of the time.
    pub(super) fn add_moving(
        &mut self,
        instance: &Instance,
        index: usize,
        own: &[Option<OwnTree>],
        tree: &mut Growing,
    ) {
        let object_from_world = instance.world_from_object.inverse();
        let whole = union(own.iter().flatten().map(|own| own.bounds));
        let corners = [whole.min.into(), whole.max.into()];
        let pieces = piece_count(&instance.motion, own.len(), corners);
        let poses: Arc<[Pose]> = instance.motion.as_slice().into();
        for piece in 0..pieces {
            let interval = piece * own.len() / pieces;
            let Some(own_tree) = &own[interval] else { continue };
            let [from, to] = [piece, piece + 1].map(|end| end as f32 / pieces as f32);
            let [low, high] = [own_tree.bounds.min, own_tree.bounds.max].map(Vec3::from);
            let still = [Pose::new(instance.world_from_object); 2];
            let keys = if poses.is_empty() { &still[..] } else { &poses };
            let [min, max] = Pose::swept(keys, [low, high], from, to);
            if !(min.is_finite() && max.is_finite()) {
                continue;
            }
            let shape = (own.len() as f32, interval as f32);
            let to = if piece + 1 == pieces { f32::INFINITY } else { to };
            let motion = Some(PlacedMotion { from, to, poses: poses.clone(), shape });
            let OwnTree { root, kind, .. } = *own_tree;
            tree.placements.push(Placement { object_from_world, root, kind, instance: index as u32, motion });
            let world = widened(Aabb { min: min.into(), max: max.into() });
            self.placements.push((world, Child::placement(tree.placements.len() - 1)));
        }
    }
}

/// Number of equal pieces of the time so that the boxes of each are not much larger than the geometry.
fn piece_count(poses: &[Pose], intervals: usize, corners: [Vec3; 2]) -> usize {
    let most = poses.windows(2).map(|pair| {
        let ends = [0.0, 1.0].map(|time| Pose::swept(pair, corners, time, time));
        let size = ends.iter().map(|[min, max]| min.distance(*max)).fold(0.0, f32::max);
        let way = (ends[1][0] + ends[1][1] - ends[0][0] - ends[0][1]).length() * 0.5;
        (pair[0].turn(&pair[1]) / MOST_TURN).max(way / (MOST_WAY * size).max(f32::MIN_POSITIVE))
    });
    let most = (most.fold(1.0, f32::max) as usize).clamp(1, MOST_PIECES).next_power_of_two();
    // Numbers of intervals are powers of two.
    (most * poses.len().saturating_sub(1)).max(intervals)
}

/// Triangles that move, by their index: their corners at both ends.
struct MovingTriangles {
    ends: Vec<[[Vec3; 3]; 2]>,
    ids: Vec<u32>,
}

impl MovingTriangles {
    /// Those that have an area at an end.
    fn new(mesh: &Mesh, key: usize) -> Self {
        let count = mesh.positions.len();
        let (mut ends, mut ids) = (Vec::new(), Vec::new());
        for (id, triangle) in mesh.triangles.iter().enumerate() {
            let poses =
                [key, key + 1].map(|key| triangle.map(|vertex| mesh.motion[key * count + vertex as usize]));
            let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length_squared();
            let areas = poses.map(area);
            if areas.iter().any(|area| *area > 0.0) && areas.iter().all(|area| area.is_finite()) {
                ends.push(poses);
                ids.push(id as u32);
            }
        }
        Self { ends, ids }
    }

    fn boxes(&self) -> impl Iterator<Item = Aabb> {
        self.ends.iter().map(|ends| {
            widened(ends.as_flattened().iter().fold(Aabb::INVALID, |mut bounds, corner| {
                bounds.extend((*corner).into());
                bounds
            }))
        })
    }
}

impl Primitives for MovingTriangles {
    const BLOCK_COST: f32 = 2.0;

    fn is_packed(&self, _primitive: u32) -> bool {
        true
    }

    fn write_leaf(&self, primitives: &[u32], tree: &mut Growing) -> Child {
        for end in 0..2 {
            let mut block = TriangleBlock::empty();
            for (lane, &primitive) in primitives.iter().enumerate() {
                block.set(lane, self.ends[primitive as usize][end], self.ids[primitive as usize]);
            }
            tree.blocks.push(block);
        }
        Child::moving_block(tree.blocks.len() - 2)
    }
}

/// Spheres that move: positions and radii at both ends.
struct MovingSpheres<'a> {
    ends: [&'a [Vec4]; 2],
}

impl MovingSpheres<'_> {
    fn boxes(&self) -> impl Iterator<Item = Aabb> {
        self.ends[0].iter().zip(self.ends[1]).map(|(first, last)| {
            let ends = [first, last].map(|sphere| Aabb {
                min: (sphere.truncate() - sphere.w).into(),
                max: (sphere.truncate() + sphere.w).into(),
            });
            widened(union(ends.into_iter()))
        })
    }
}

impl Primitives for MovingSpheres<'_> {
    const BLOCK_COST: f32 = 1.0;

    fn is_packed(&self, _primitive: u32) -> bool {
        true
    }

    fn write_leaf(&self, primitives: &[u32], tree: &mut Growing) -> Child {
        for end in self.ends {
            let mut block = SphereBlock::empty();
            for (lane, &id) in primitives.iter().enumerate() {
                let sphere = end[id as usize];
                block.set(lane, sphere.truncate(), sphere.w, id);
            }
            tree.sphere_blocks.push(block);
        }
        Child::spheres(tree.sphere_blocks.len() - 2)
    }
}
