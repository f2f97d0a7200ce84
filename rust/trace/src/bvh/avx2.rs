//! The kernel with AVX2 and FMA: a node is six loads and one comparison, a block one Moeller-Trumbore test of eight
//! triangles at once (Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997).

use std::{arch::x86_64::*, mem::MaybeUninit};

use glam::Vec3;

use super::{
    Ray,
    strands::{SLACK, StrandBlock, StrandRay},
    traverse::{
        BlockHits, EDGE_SLACK, EXIT_SLACK, LocalRay, MAX_EDGE_SLACK, NearestHit, TraversalKernel, traverse,
    },
    tree::{BvhLanes, BvhNode, Child, Tree, TriangleBlock, WIDTH},
};

/// [`traverse`] compiled for AVX2.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
pub(super) fn traverse_avx2<const ANY: bool>(
    tree: &Tree,
    ray: &Ray,
    root: Option<Child>,
    stack: &mut [MaybeUninit<u64>],
    accept: impl Fn(u32, u32) -> bool,
    enter_placement: impl Fn(u32) -> bool,
    source: impl Fn(u32) -> u32,
) -> Option<NearestHit> {
    traverse::<Avx2Ray, ANY>(tree, ray, root, stack, accept, enter_placement, source)
}

/// A ray with each coordinate in all lanes. Only made within [`traverse_avx2`].
#[derive(Clone, Copy)]
struct Avx2Ray {
    origin: [__m256; 3],
    direction: [__m256; 3],
    inverse: [__m256; 3],
}

type V3 = [__m256; 3];

#[inline(always)]
fn load(lanes: &BvhLanes) -> __m256 {
    // SAFETY: `BvhLanes` is 32 bytes, aligned to 32; the caller runs with AVX2.
    unsafe { _mm256_load_ps(lanes.0.as_ptr()) }
}

#[inline(always)]
fn store(value: __m256) -> BvhLanes {
    let mut lanes = BvhLanes([0.0; WIDTH]);
    // SAFETY: as for `load`.
    unsafe { _mm256_store_ps(lanes.0.as_mut_ptr(), value) };
    lanes
}

#[inline(always)]
fn splat(vector: Vec3) -> V3 {
    // SAFETY: the caller runs with AVX2.
    unsafe { [_mm256_set1_ps(vector.x), _mm256_set1_ps(vector.y), _mm256_set1_ps(vector.z)] }
}

#[inline(always)]
fn cross(a: V3, b: V3) -> V3 {
    // SAFETY: the caller runs with AVX2 and FMA.
    unsafe {
        [
            _mm256_fmsub_ps(a[1], b[2], _mm256_mul_ps(a[2], b[1])),
            _mm256_fmsub_ps(a[2], b[0], _mm256_mul_ps(a[0], b[2])),
            _mm256_fmsub_ps(a[0], b[1], _mm256_mul_ps(a[1], b[0])),
        ]
    }
}

#[inline(always)]
fn dot(a: V3, b: V3) -> __m256 {
    // SAFETY: the caller runs with AVX2 and FMA.
    unsafe { _mm256_fmadd_ps(a[0], b[0], _mm256_fmadd_ps(a[1], b[1], _mm256_mul_ps(a[2], b[2]))) }
}

#[inline(always)]
fn dot_flat(a: [__m256; 2], b: [__m256; 2]) -> __m256 {
    // SAFETY: the caller runs with AVX2 and FMA.
    unsafe { _mm256_fmadd_ps(a[0], b[0], _mm256_mul_ps(a[1], b[1])) }
}

/// Whole numbers of a lattice.
#[inline(always)]
fn steps(coordinates: &[u16; WIDTH]) -> __m256 {
    // SAFETY: 16 bytes are read, which need no alignment; the caller runs with AVX2.
    unsafe {
        let packed = _mm_loadu_si128(coordinates.as_ptr().cast());
        _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(packed))
    }
}

impl TraversalKernel for Avx2Ray {
    #[inline(always)]
    fn new(ray: &LocalRay) -> Self {
        Self { origin: splat(ray.origin), direction: splat(ray.direction), inverse: splat(ray.inverse) }
    }

    #[inline(always)]
    fn enter(&self, ray: &LocalRay, node: &BvhNode, t_min: f32, t_max: f32) -> (u32, BvhLanes) {
        // SAFETY: the caller runs with AVX2; plane indices are below 6 by construction of `LocalRay`.
        unsafe {
            let distance = |plane: usize, axis: usize| {
                let planes = load(node.planes.get_unchecked(plane));
                _mm256_mul_ps(_mm256_sub_ps(planes, self.origin[axis]), self.inverse[axis])
            };
            let near = _mm256_max_ps(
                _mm256_max_ps(distance(ray.near[0], 0), distance(ray.near[1], 1)),
                _mm256_max_ps(distance(ray.near[2], 2), _mm256_set1_ps(t_min)),
            );
            let far = _mm256_min_ps(
                _mm256_min_ps(distance(ray.far[0], 0), distance(ray.far[1], 1)),
                distance(ray.far[2], 2),
            );
            let far = _mm256_min_ps(_mm256_mul_ps(far, _mm256_set1_ps(EXIT_SLACK)), _mm256_set1_ps(t_max));
            let inside = _mm256_cmp_ps::<_CMP_LE_OQ>(near, far);
            (_mm256_movemask_ps(inside) as u32, store(near))
        }
    }

    #[inline(always)]
    fn near_strands(block: &StrandBlock, ray: &StrandRay, z_max: f32) -> u32 {
        // Not by `map`: a closure that is not inlined would hand vectors over in memory.
        let [x, y, z] = ray.axes;
        let corner = splat(ray.inside(Vec3::from(block.corner) - ray.origin));
        let (x, y, z) = (splat(x), splat(y), splat(z));
        let start = [steps(&block.ends[0]), steps(&block.ends[1]), steps(&block.ends[2])];
        let end = [steps(&block.ends[3]), steps(&block.ends[4]), steps(&block.ends[5])];
        // SAFETY: the caller runs with AVX2 and FMA.
        unsafe {
            let step = _mm256_set1_ps(block.step);
            let start = [
                _mm256_fmadd_ps(dot(x, start), step, corner[0]),
                _mm256_fmadd_ps(dot(y, start), step, corner[1]),
                _mm256_fmadd_ps(dot(z, start), step, corner[2]),
            ];
            let end = [
                _mm256_fmadd_ps(dot(x, end), step, corner[0]),
                _mm256_fmadd_ps(dot(y, end), step, corner[1]),
                _mm256_fmadd_ps(dot(z, end), step, corner[2]),
            ];
            let axis = [_mm256_sub_ps(end[0], start[0]), _mm256_sub_ps(end[1], start[1])];
            let reach = _mm256_mul_ps(steps(&block.reach), step);
            let (zero, sign) = (_mm256_setzero_ps(), _mm256_set1_ps(-0.0));
            let across = _mm256_max_ps(dot_flat(axis, axis), _mm256_set1_ps(f32::MIN_POSITIVE));
            let along = _mm256_div_ps(_mm256_xor_ps(dot_flat([start[0], start[1]], axis), sign), across);
            let along = _mm256_min_ps(_mm256_max_ps(along, zero), _mm256_set1_ps(1.0));
            let nearest =
                [_mm256_fmadd_ps(axis[0], along, start[0]), _mm256_fmadd_ps(axis[1], along, start[1])];
            let size = _mm256_add_ps(_mm256_andnot_ps(sign, start[0]), _mm256_andnot_ps(sign, start[1]));
            let size = _mm256_add_ps(size, _mm256_andnot_ps(sign, start[2]));
            let wide = _mm256_fmadd_ps(_mm256_set1_ps(SLACK), size, reach);
            let low = _mm256_sub_ps(_mm256_min_ps(start[2], end[2]), wide);
            let high = _mm256_add_ps(_mm256_max_ps(start[2], end[2]), wide);
            let apart = _mm256_fmadd_ps(nearest[0], nearest[0], _mm256_mul_ps(nearest[1], nearest[1]));
            let is_beside = _mm256_cmp_ps::<_CMP_LE_OQ>(apart, _mm256_mul_ps(wide, wide));
            let is_there = _mm256_cmp_ps::<_CMP_GT_OQ>(reach, zero);
            let is_within = _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_LT_OQ>(low, _mm256_set1_ps(z_max)),
                _mm256_cmp_ps::<_CMP_GT_OQ>(high, zero),
            );
            _mm256_movemask_ps(_mm256_and_ps(_mm256_and_ps(is_beside, is_there), is_within)) as u32
        }
    }

    #[inline(always)]
    fn hit(&self, block: &TriangleBlock, t_min: f32, t_max: f32) -> BlockHits {
        let vector = |lanes: &[BvhLanes; 3]| [load(&lanes[0]), load(&lanes[1]), load(&lanes[2])];
        let (edge_1, edge_2) = (vector(&block.edge_1), vector(&block.edge_2));
        let corner = vector(&block.corner);
        // SAFETY: the caller runs with AVX2 and FMA.
        unsafe {
            let to_origin = [
                _mm256_sub_ps(self.origin[0], corner[0]),
                _mm256_sub_ps(self.origin[1], corner[1]),
                _mm256_sub_ps(self.origin[2], corner[2]),
            ];
            let p = cross(self.direction, edge_2);
            let q = cross(to_origin, edge_1);
            let inverse_det = _mm256_div_ps(_mm256_set1_ps(1.0), dot(edge_1, p));
            let u = _mm256_mul_ps(dot(to_origin, p), inverse_det);
            let v = _mm256_mul_ps(dot(self.direction, q), inverse_det);
            let t = _mm256_mul_ps(dot(edge_2, q), inverse_det);
            let reach = load(&block.reach);
            let sign = _mm256_set1_ps(-0.0);
            let span =
                _mm256_mul_ps(_mm256_set1_ps(EDGE_SLACK), _mm256_add_ps(_mm256_andnot_ps(sign, t), reach));
            let slack = _mm256_mul_ps(span, _mm256_mul_ps(reach, _mm256_andnot_ps(sign, inverse_det)));
            let slack = _mm256_min_ps(slack, _mm256_set1_ps(MAX_EDGE_SLACK));
            let inside = _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(_mm256_add_ps(_mm256_min_ps(u, v), slack), _mm256_setzero_ps()),
                _mm256_cmp_ps::<_CMP_LE_OQ>(_mm256_sub_ps(_mm256_add_ps(u, v), slack), _mm256_set1_ps(1.0)),
            );
            let in_range = _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GT_OQ>(t, _mm256_set1_ps(t_min)),
                _mm256_cmp_ps::<_CMP_LT_OQ>(t, _mm256_set1_ps(t_max)),
            );
            let mask = _mm256_movemask_ps(_mm256_and_ps(inside, in_range)) as u32;
            BlockHits { mask, t: store(t), u: store(u), v: store(v) }
        }
    }
}
