//! The kernel in plain Rust: for processors without AVX2, and the oracle of the AVX2 one.

use glam::Vec3;

use super::{
    strands::{SLACK, StrandBlock, StrandRay},
    traverse::{BlockHits, EDGE_SLACK, EXIT_SLACK, LocalRay, MAX_EDGE_SLACK, TraversalKernel},
    tree::{BvhLanes, BvhNode, TriangleBlock, WIDTH},
};

#[derive(Clone, Copy)]
pub(super) struct Scalar {
    origin: Vec3,
    direction: Vec3,
}

impl TraversalKernel for Scalar {
    fn new(ray: &LocalRay) -> Self {
        Self { origin: ray.origin, direction: ray.direction }
    }

    fn enter(&self, ray: &LocalRay, node: &BvhNode, t_min: f32, t_max: f32) -> (u32, BvhLanes) {
        let (mut near, mut far) = ([t_min; WIDTH], [t_max; WIDTH]);
        for axis in 0..3 {
            let (near_planes, far_planes) = (&node.planes[ray.near[axis]], &node.planes[ray.far[axis]]);
            for lane in 0..WIDTH {
                let distance = |plane: f32| (plane - ray.origin[axis]) * ray.inverse[axis];
                near[lane] = near[lane].max(distance(near_planes.0[lane]));
                far[lane] = far[lane].min(distance(far_planes.0[lane]) * EXIT_SLACK);
            }
        }
        let mask = (0..WIDTH).fold(0, |mask, lane| mask | u32::from(near[lane] <= far[lane]) << lane);
        (mask, BvhLanes(near))
    }

    fn near_strands(block: &StrandBlock, ray: &StrandRay, z_max: f32) -> u32 {
        let is_near = |lane: usize| {
            let (start, end, reach) = block.lane(lane);
            let (start, end) = (ray.inside(start - ray.origin), ray.inside(end - ray.origin));
            let axis = end - start;
            let across = axis.truncate();
            let along = -start.truncate().dot(across) / across.length_squared().max(f32::MIN_POSITIVE);
            let nearest = start.truncate() + across * along.clamp(0.0, 1.0);
            let wide = reach + SLACK * start.abs().element_sum();
            let (low, high) = (start.z.min(start.z + axis.z) - wide, start.z.max(start.z + axis.z) + wide);
            reach > 0.0 && nearest.length_squared() <= wide * wide && low < z_max && high > 0.0
        };
        (0..WIDTH).fold(0, |mask, lane| mask | u32::from(is_near(lane)) << lane)
    }

    fn hit(&self, block: &TriangleBlock, t_min: f32, t_max: f32) -> BlockHits {
        let mut hits = BlockHits {
            mask: 0,
            t: BvhLanes([0.0; WIDTH]),
            u: BvhLanes([0.0; WIDTH]),
            v: BvhLanes([0.0; WIDTH]),
        };
        for lane in 0..WIDTH {
            let vector =
                |lanes: &[BvhLanes; 3]| Vec3::new(lanes[0].0[lane], lanes[1].0[lane], lanes[2].0[lane]);
            let (edge_1, edge_2) = (vector(&block.edge_1), vector(&block.edge_2));
            let to_origin = self.origin - vector(&block.corner);
            let p = self.direction.cross(edge_2);
            let q = to_origin.cross(edge_1);
            let inverse_det = 1.0 / edge_1.dot(p);
            let (u, v) = (to_origin.dot(p) * inverse_det, self.direction.dot(q) * inverse_det);
            let t = edge_2.dot(q) * inverse_det;
            let reach = block.reach.0[lane];
            let slack = (EDGE_SLACK * (t.abs() + reach) * (reach * inverse_det.abs())).min(MAX_EDGE_SLACK);
            let inside = u.min(v) >= -slack && u + v <= 1.0 + slack;
            if inside && t > t_min && t < t_max {
                hits.mask |= 1 << lane;
                (hits.t.0[lane], hits.u.0[lane], hits.v.0[lane]) = (t, u, v);
            }
        }
        hits
    }
}
