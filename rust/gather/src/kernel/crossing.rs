//! Fast tests on eight segments at a time: which of them may cross a light.

use glam::Vec3;

use super::block::SegmentGroup;
use crate::lanes::{Lanes, Vec3x};
use crate::light::{Ball, Plane};

/// Replaces `numbers` by the numbers of the bits that are set.
#[inline(always)]
pub fn collect(bits: &[u8], numbers: &mut Vec<u16>) {
    numbers.clear();
    for (chunk, bytes) in bits.chunks(8).enumerate() {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        let mut word = u64::from_le_bytes(word);
        while word != 0 {
            numbers.push((chunk * 64) as u16 + word.trailing_zeros() as u16);
            word &= word - 1;
        }
    }
}

type Tested<'a> = std::iter::Zip<std::slice::Iter<'a, SegmentGroup>, std::slice::IterMut<'a, u8>>;

/// The segments that come within the radius of the centre, and some more for rounding.
#[inline(always)]
pub fn near_ball<L: Lanes>(groups: Tested<'_>, ball: &Ball, slack: f32) {
    let radius = ball.radius * 1.000_01 + slack;
    let (center, radius2) = (Vec3x::<L>::splat(ball.center), L::splat(radius * radius));
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let to_center = center.sub(Vec3x::load(&group.origin));
        let share = to_center.dot_fused(edge).mul(L::load(&group.inverse_length2)).max(zero).min(one);
        let nearest = to_center.sub_scaled(edge, share);
        *candidates = nearest.dot_fused(nearest).le(radius2).sign_bits();
    }
}

/// The segments that cross a rectangle from its front: the operations of `Plane::crossing_cosine`.
#[inline(always)]
pub fn through_plane<L: Lanes>(groups: Tested<'_>, plane: &Plane) {
    let (center, normal) = (Vec3x::<L>::splat(plane.center), Vec3x::splat(plane.normal));
    let (inverse_u, inverse_v) = (Vec3x::splat(plane.inverse_u), Vec3x::splat(plane.inverse_v));
    let (zero, half) = (L::splat(0.0), L::splat(0.5));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let to_center = center.sub(Vec3x::load(&group.origin));
        let (height, slope) = (to_center.dot(normal), edge.dot(normal));
        let passed = slope.lt(zero).and(height.lt(zero)).and(slope.lt(height));
        let in_plane = edge.scale(height.div(slope)).sub(to_center);
        let (u, v) = (in_plane.dot(inverse_u), in_plane.dot(inverse_v));
        *candidates = passed.and(u.abs().le(half)).and(v.abs().le(half)).sign_bits();
    }
}

/// The segments that come from the front of a rectangle and cross it before or after they end, by up to `ends` metres.
#[inline(always)]
pub fn through_slab<L: Lanes>(groups: Tested<'_>, plane: &Plane, ends: f32) {
    let (center, normal) = (Vec3x::<L>::splat(plane.center), Vec3x::splat(plane.normal));
    let (inverse_u, inverse_v) = (Vec3x::splat(plane.inverse_u), Vec3x::splat(plane.inverse_v));
    let (half, ends) = (L::splat(0.5), L::splat(ends));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let to_center = center.sub(Vec3x::load(&group.origin));
        let slope = edge.dot_fused(normal);
        let share = to_center.dot_fused(normal).div(slope);
        let beyond = ends.mul(L::load(&group.inverse_length2).sqrt());
        // How far the crossing is from the middle, in lengths.
        let along = share.sub(half).abs().le(half.add(beyond));
        let in_plane = edge.scale(share).sub(to_center);
        let (u, v) = (in_plane.dot_fused(inverse_u), in_plane.dot_fused(inverse_v));
        let inside = u.abs().le(half).and(v.abs().le(half));
        *candidates = slope.lt(L::splat(0.0)).and(along).and(inside).sign_bits();
    }
}

/// The segments within a chord of a direction: the operations of the sun's profile, which also checks that they escape.
#[inline(always)]
pub fn along<L: Lanes>(groups: Tested<'_>, direction: Vec3, chord2: f32) {
    let (direction, chord2) = (Vec3x::<L>::splat(direction), L::splat(chord2));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let length = edge.dot(edge).sqrt();
        let apart =
            Vec3x { x: edge.x.div(length), y: edge.y.div(length), z: edge.z.div(length) }.sub(direction);
        *candidates = apart.dot(apart).le(chord2).sign_bits();
    }
}
