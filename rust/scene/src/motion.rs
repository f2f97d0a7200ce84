//! Motion within the time that the shutter is open: keys of transforms and shapes, and the one place where they are
//! interpolated.
//!
//! Times are shares of the shutter's interval, 0 where it opens and 1 where it closes. Keys are equally spaced over it.

use std::{
    f32::consts::TAU,
    ops::{Add, Mul},
};

use glam::{Affine3A, BVec3, Mat3, Mat3A, Quat, Vec3, Vec4};

use crate::{Curves, Instance, Mesh, Points, Scene};

/// Time of everything that stands still, in the middle of the interval.
pub const STILL: f32 = 0.5;

/// Steps of the iteration that finds a rotation; it converges quadratically.
const POLAR_STEPS: usize = 100;

/// When a camera sees: the times of its paths.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shutter {
    /// How far the shutter is open at equally spaced times, from its opening to its closing; any unit.
    pub curve: Vec<f32>,
    /// Share of the interval in which one line of the film is exposed, where lines follow each other from the top; nothing
    /// where all are exposed together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rolling: Option<f32>,
}

impl Shutter {
    /// Fault in words, if there is any.
    pub(crate) fn fault(&self) -> Option<&'static str> {
        let is_sound = self.curve.iter().all(|open| *open >= 0.0 && open.is_finite());
        if self.curve.is_empty() || !is_sound || !self.curve.iter().any(|open| *open > 0.0) {
            Some("its shutter never opens; reset the shutter curve")
        } else if !self.rolling.is_none_or(|share| (0.0..=1.0).contains(&share)) {
            Some("the duration of its rolling shutter is not within 0 and 1")
        } else {
            None
        }
    }
}

/// Transform at a key, in parts that are interpolated each in its own way, as in Cycles (`util/transform.h`).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Pose {
    rotation: Quat,
    translation: Vec3,
    /// Scale and shear, before the rotation.
    stretch: Mat3,
}

impl Pose {
    /// Poses of transforms at keys; none where the transform is the same at all of them.
    pub fn keys(transforms: &[Affine3A]) -> Vec<Self> {
        if transforms.windows(2).all(|pair| pair[0] == pair[1]) {
            return Vec::new();
        }
        transforms.iter().map(|transform| Self::new(*transform)).collect()
    }

    /// Pose of a transform, by polar decomposition with Higham's iteration (Shoemake and Duff, "Matrix Animation and Polar
    /// Decomposition", 1992). Mirroring is part of the stretch.
    pub fn new(transform: Affine3A) -> Self {
        let matrix = Mat3::from(transform.matrix3);
        let mut rotation = matrix;
        for _ in 0..POLAR_STEPS {
            let next = (rotation + rotation.inverse().transpose()) * 0.5;
            let is_done = next.abs_diff_eq(rotation, 1e-6);
            // Of a flat matrix there is no inverse.
            if !next.is_finite() {
                break;
            }
            rotation = next;
            if is_done {
                break;
            }
        }
        if rotation.determinant() < 0.0 {
            rotation = -rotation;
        }
        let rotation = Quat::from_mat3(&rotation).normalize();
        let stretch = Mat3::from_quat(rotation).transpose() * matrix;
        Self { rotation, translation: transform.translation.into(), stretch }
    }

    /// The transform.
    pub fn world_from_local(&self) -> Affine3A {
        let matrix = Mat3A::from_quat(self.rotation) * Mat3A::from(self.stretch);
        Affine3A { matrix3: matrix, translation: self.translation.into() }
    }

    /// The transform at a time between keys. Rotations go the shorter way.
    pub fn at(keys: &[Self], time: f32) -> Affine3A {
        let (key, share) = place(keys.len(), time);
        let (from, to) = (&keys[key], &keys[key + 1]);
        let between = Self {
            rotation: from.rotation.slerp(to.rotation, share),
            translation: blend(from.translation, to.translation, share),
            stretch: blend(from.stretch, to.stretch, share),
        };
        between.world_from_local()
    }

    /// Angle of the rotation to the next key, radians.
    pub fn turn(&self, next: &Self) -> f32 {
        let angle = self.rotation.angle_between(next.rotation);
        angle.min(TAU - angle)
    }

    /// Lowest and highest corner of what holds a box at all times between two that lie between the same keys. Paths of
    /// points leave their chord by no more than an eighth of their largest second derivative.
    pub fn swept(keys: &[Self], [low, high]: [Vec3; 2], from: f32, to: f32) -> [Vec3; 2] {
        let (key, start) = place(keys.len(), from);
        let end = to * (keys.len() - 1) as f32 - key as f32;
        let (first, last) = (&keys[key], &keys[key + 1]);
        let angle = first.turn(last) * (end - start);
        let stretches = [start, end].map(|share| blend(first.stretch, last.stretch, share));
        let poses = [from, to].map(|time| Self::at(keys, time));
        let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for corner in 0..8_u32 {
            let is_high = BVec3::new(corner & 1 != 0, corner & 2 != 0, corner & 4 != 0);
            let corner = Vec3::select(is_high, high, low);
            let [a, b] = stretches.map(|stretch| stretch * corner);
            let bend = (angle * angle * a.length().max(b.length()) + 2.0 * angle * a.distance(b)) / 8.0;
            for end in poses.map(|pose| pose.transform_point3(corner)) {
                (min, max) = (min.min(end - bend), max.max(end + bend));
            }
        }
        [min, max]
    }
}

/// Key before a time, and how far the time is on the way to the next one. There are at least two keys.
pub fn place(keys: usize, time: f32) -> (usize, f32) {
    let scaled = time * (keys - 1) as f32;
    let key = (scaled as usize).min(keys - 2);
    (key, scaled - key as f32)
}

/// Linear interpolation.
pub fn blend<T: Mul<f32, Output = T> + Add<Output = T>>(from: T, to: T, share: f32) -> T {
    from * (1.0 - share) + to * share
}

/// Value of an element at a time among values at all keys, key after key.
fn value_at<T: Copy + Mul<f32, Output = T> + Add<Output = T>>(
    keys: &[T],
    elements: usize,
    element: usize,
    time: f32,
) -> T {
    let (key, share) = place(keys.len() / elements, time);
    let first = key * elements + element;
    blend(keys[first], keys[first + elements], share)
}

impl Instance {
    /// Its transform at a time.
    pub fn world_from_object_at(&self, time: f32) -> Affine3A {
        if self.motion.is_empty() { self.world_from_object } else { Pose::at(&self.motion, time) }
    }
}

impl Mesh {
    /// Corners of a triangle at a time, object space.
    pub fn corners_at(&self, triangle: usize, time: f32) -> [Vec3; 3] {
        let corners = self.triangles[triangle].map(|vertex| vertex as usize);
        if self.motion.is_empty() {
            return corners.map(|vertex| self.positions[vertex]);
        }
        corners.map(|vertex| value_at(&self.motion, self.positions.len(), vertex, time))
    }
}

impl Curves {
    /// Position and radius of a key at a time, object space.
    pub fn key_at(&self, key: usize, time: f32) -> Vec4 {
        if self.motion.is_empty() {
            return self.keys[key].extend(self.radii[key]);
        }
        value_at(&self.motion, self.keys.len(), key, time)
    }
}

impl Points {
    /// Position and radius of a point at a time, object space.
    pub fn sphere_at(&self, point: usize, time: f32) -> Vec4 {
        if self.motion.is_empty() {
            return self.positions[point].extend(self.radii[point]);
        }
        value_at(&self.motion, self.positions.len(), point, time)
    }
}

impl Scene {
    /// Number of keys of the shape of a geometry; 0 where it keeps its shape.
    pub fn shape_keys(&self, geometry: crate::Geometry) -> usize {
        let count = |keys: usize, elements: usize| keys.checked_div(elements).unwrap_or(0);
        (self.mesh(geometry).map(|mesh| count(mesh.motion.len(), mesh.positions.len())))
            .or_else(|| self.curves(geometry).map(|curves| count(curves.motion.len(), curves.keys.len())))
            .or_else(|| {
                self.points(geometry).map(|points| count(points.motion.len(), points.positions.len()))
            })
            .unwrap_or(0)
    }
}

/// Fault of keys in words, if there is any: their number is one more than a power of two, so that the middle of the
/// interval has one.
pub(crate) fn keys_fault(keys: usize) -> Option<&'static str> {
    let is_sound = keys == 0 || (keys > 2 && (keys - 1).is_power_of_two());
    (!is_sound).then_some("its motion has no key in the middle of each interval")
}

/// True if a ray can meet a sphere or the key of a strand, with its radius last.
pub(crate) fn is_sphere(sphere: &Vec4) -> bool {
    sphere.is_finite() && sphere.w >= 0.0
}

/// Fault of the values at keys of so many elements.
pub(crate) fn shape_fault<T>(
    keys: &[T],
    elements: usize,
    is_sound: impl Fn(&T) -> bool,
) -> Option<&'static str> {
    if keys.is_empty() {
        None
    } else if elements == 0 || !keys.len().is_multiple_of(elements) {
        Some("its arrays differ in length")
    } else if !keys.iter().all(is_sound) {
        Some("its motion is not a finite number")
    } else {
        keys_fault(keys.len() / elements)
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;

    fn turned(angle: f32, scale: Vec3) -> Affine3A {
        Affine3A::from_scale_rotation_translation(scale, Quat::from_rotation_z(angle), Vec3::X * angle)
    }

    #[test]
    fn poses_pass_through_their_keys_and_turn_evenly_between() {
        let scales = [Vec3::ONE, Vec3::new(1.0, 3.0, 2.0), Vec3::splat(5.0)];
        let keys = [0, 1, 2].map(|key| turned(key as f32 * 0.5 * PI, scales[key]));
        let poses = Pose::keys(&keys);
        for (key, time) in [0.0, 0.5, 1.0].into_iter().enumerate() {
            assert!(Pose::at(&poses, time).abs_diff_eq(keys[key], 1e-5), "key {key}");
        }
        // Half-way in angle, place and scale, not in the matrix.
        let half_way = turned(0.25 * PI, Vec3::new(1.0, 2.0, 1.5));
        assert!(Pose::at(&poses, 0.25).abs_diff_eq(half_way, 1e-5));
        assert!((poses[0].turn(&poses[1]) - 0.5 * PI).abs() < 1e-5);
    }

    #[test]
    fn mirrored_and_sheared_transforms_are_kept() {
        let sheared = Mat3::from_cols(Vec3::new(-2.0, 0.5, 0.0), Vec3::new(0.3, 1.0, 0.0), Vec3::Z);
        let transform = Affine3A::from_mat3_translation(sheared, Vec3::Y);
        let poses = Pose::keys(&[transform, Affine3A::IDENTITY]);
        assert!(Pose::at(&poses, 0.0).abs_diff_eq(transform, 1e-5));
    }

    #[test]
    fn swept_boxes_hold_their_points_at_all_times_between() {
        let transforms =
            [0.0, 1.2, 2.9].map(|angle| turned(angle, Vec3::new(1.0 + angle, 1.0, 2.0 - 0.5 * angle)));
        let poses = Pose::keys(&transforms);
        let own = [Vec3::new(0.5, -1.0, 0.0), Vec3::new(2.0, 1.0, 0.3)];
        for (from, to) in [(0.0, 0.5), (0.5, 1.0), (0.5, 0.75)] {
            let [min, max] = Pose::swept(&poses, own, from, to);
            for step in 0..=20 {
                let pose = Pose::at(&poses, from + (to - from) * step as f32 / 20.0);
                for corner in [own[0], own[1], own[0].with_x(2.0), own[1].with_z(0.0)] {
                    let place = pose.transform_point3(corner);
                    assert!(place.cmpge(min - 1e-5).all() && place.cmple(max + 1e-5).all(), "{from} {step}");
                }
            }
            // No wider than a whole turn of the farthest corner on its way.
            let [first, last] = [from, to].map(|time| Pose::at(&poses, time));
            let farthest =
                first.transform_vector3(own[1]).length().max(last.transform_vector3(own[1]).length());
            let way = Vec3::from(last.translation - first.translation).length();
            assert!((max - min).max_element() < 2.0 * farthest + way, "{min} {max}");
        }
    }

    #[test]
    fn what_does_not_move_has_no_keys() {
        assert!(Pose::keys(&[turned(1.0, Vec3::ONE); 3]).is_empty());
        let instance = Instance::new("a", 0, turned(1.0, Vec3::ONE), vec![]);
        assert_eq!(instance.world_from_object_at(0.9), instance.world_from_object);
    }

    #[test]
    fn shapes_move_straight_between_their_keys() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            motion: (0..9).map(|i| Vec3::splat(i as f32)).collect(),
            ..Mesh::default()
        };
        assert_eq!(mesh.corners_at(0, 0.25), [1.5, 2.5, 3.5].map(Vec3::splat));
        assert_eq!(mesh.corners_at(0, 1.0), [6.0, 7.0, 8.0].map(Vec3::splat));
        let still = Mesh { motion: Vec::new(), ..mesh };
        assert_eq!(still.corners_at(0, 0.25), [Vec3::ZERO, Vec3::X, Vec3::Y]);
    }

    #[test]
    fn keys_lie_on_the_middle_of_each_interval() {
        assert_eq!([0, 3, 5, 9].map(keys_fault), [None; 4]);
        assert!([1, 2, 4, 7].into_iter().all(|keys| keys_fault(keys).is_some()));
        assert!(shape_fault(&[1.0; 7], 3, |_| true).is_some());
        assert!(shape_fault(&[f32::NAN; 9], 3, |value| value.is_finite()).is_some());
        assert_eq!(shape_fault(&[1.0_f32; 9], 3, |value| value.is_finite()), None);
    }

    #[test]
    fn shutters_that_never_open_are_refused() {
        let shutter = |curve: &[f32], rolling| Shutter { curve: curve.to_vec(), rolling };
        assert_eq!(shutter(&[0.0, 1.0], Some(0.1)).fault(), None);
        for fault in [shutter(&[], None), shutter(&[0.0], None), shutter(&[-1.0, 2.0], None)] {
            assert!(fault.fault().is_some_and(|words| words.contains("curve")), "{fault:?}");
        }
        assert!(shutter(&[1.0], Some(2.0)).fault().is_some());
    }
}
