use glam::Vec3;
use relume_scene::{Geometry, Instance, Light, LightShape, Pose, Scene};

/// Room that is left around a scene in which all space is filled, so that lights can be moved there: as much as it is wide, on each
/// side.
const ROOM: f32 = 1.0;

/// A box along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    min: Vec3,
    max: Vec3,
}

impl Bounds {
    /// Nothing.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    fn of_points(points: impl Iterator<Item = Vec3>) -> Self {
        points.fold(Self::EMPTY, |bounds, point| bounds.with(Self { min: point, max: point }))
    }

    /// Box of a geometry at all times, in object space. Of strands and points only the middle lines and centres count.
    pub fn of_geometry(scene: &Scene, geometry: Geometry) -> Self {
        let mesh = scene.mesh(geometry).map(|mesh| [&mesh.positions, &mesh.motion]);
        let curves = scene.curves(geometry).map(|curves| (&curves.keys, &curves.motion));
        let points = scene.points(geometry).map(|points| (&points.positions, &points.motion));
        let spheres = [curves, points].into_iter().flatten();
        let moved = spheres.clone().flat_map(|(_, motion)| motion).map(|sphere| sphere.truncate());
        let still = mesh.into_iter().flatten().chain(spheres.map(|(still, _)| still));
        Self::of_points(still.flatten().copied().chain(moved))
    }

    /// Box around an instance at all times.
    pub fn of_instance(scene: &Scene, instance: &Instance) -> Self {
        let own = Self::of_geometry(scene, instance.geometry);
        if own.min.cmpgt(own.max).any() {
            return own;
        }
        if !instance.motion.is_empty() {
            let intervals = instance.motion.len() - 1;
            let boxes = (0..intervals).map(|key| {
                let [from, to] = [key, key + 1].map(|key| key as f32 / intervals as f32);
                let [min, max] = Pose::swept(&instance.motion, [own.min, own.max], from, to);
                Self { min, max }
            });
            return boxes.fold(Self::EMPTY, Self::with);
        }
        let corner = |index: usize| {
            let pick = |axis: usize| if index >> axis & 1 == 0 { own.min[axis] } else { own.max[axis] };
            instance.world_from_object.transform_point3(Vec3::new(pick(0), pick(1), pick(2)))
        };
        Self::of_points((0..8).map(corner))
    }

    /// Box around everything that matters in a space that is filled with a medium: objects, camera and lights, with room around
    /// them. Vertices of paths beyond it would make the steps in which positions are stored too coarse, so that what is
    /// recorded ends there. Lights beyond it are not met.
    pub fn of_scene(scene: &Scene, lights: &[Light]) -> Self {
        let camera = scene.camera.world_from_camera;
        let moved = scene.camera.motion.iter().map(|pose| pose.world_from_local());
        let places = std::iter::once(camera).chain(moved).map(|pose| pose.translation.into());
        let mut bounds = Self::of_points(places);
        for instance in &scene.instances {
            bounds = bounds.with(Self::of_instance(scene, instance));
        }
        for light in lights {
            if let Some((center, radius)) = ball(&light.shape) {
                bounds = bounds.with(Self { min: center - radius, max: center + radius });
            }
        }
        let room = ((bounds.max - bounds.min).max_element() * ROOM).max(1e-3);
        Self { min: bounds.min - room, max: bounds.max + room }
    }

    /// Box around two.
    pub fn with(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The point in its middle.
    pub fn middle(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// True if a point is in it, or a rounding outside.
    pub fn contains(&self, point: Vec3) -> bool {
        let slack = Vec3::splat(1e-5) * self.min.abs().max(self.max.abs());
        point.cmpge(self.min - slack).all() && point.cmple(self.max + slack).all()
    }

    /// A length that leads out of the box from a point, whatever the direction.
    pub fn reach(&self, point: Vec3) -> f32 {
        2.0 * ((self.max - self.min).length() + (point - self.min).length())
    }

    /// Lower and upper corner.
    pub fn corners(&self) -> [Vec3; 2] {
        [self.min, self.max]
    }

    /// The part of the way from one point to another that is in the box; nothing if there is none.
    pub fn clip(&self, start: Vec3, end: Vec3) -> Option<[Vec3; 2]> {
        let way = end - start;
        let (mut enter, mut exit) = (0.0_f32, 1.0_f32);
        for axis in 0..3 {
            if way[axis] == 0.0 {
                if start[axis] < self.min[axis] || start[axis] > self.max[axis] {
                    return None;
                }
                continue;
            }
            let [a, b] = [self.min[axis], self.max[axis]].map(|plane| (plane - start[axis]) / way[axis]);
            enter = enter.max(a.min(b));
            exit = exit.min(a.max(b));
        }
        let at =
            |share: f32, whole: f32, point: Vec3| if share == whole { point } else { start + way * share };
        (enter < exit).then(|| [at(enter, 0.0, start), at(exit, 1.0, end)])
    }
}

/// True if part of a light is outside of the box with these corners, beyond which no path was recorded
/// ([`relume_dump::Manifest::recorded`]). What is there of it lights nothing.
pub fn reaches_beyond(light: &LightShape, corners: [[f32; 3]; 2]) -> bool {
    let [min, max] = corners.map(Vec3::from);
    let bounds = Bounds { min, max };
    ball(light).is_some_and(|(center, radius)| {
        ![center - radius, center + radius].iter().all(|p| bounds.contains(*p))
    })
}

/// Middle and radius of a ball around a light; none of a sun.
fn ball(shape: &LightShape) -> Option<(Vec3, f32)> {
    match *shape {
        LightShape::Sphere { center, radius }
        | LightShape::FacingDisk { center, radius }
        | LightShape::Spot { center, radius, .. }
        | LightShape::StretchedSpot { center, radius, .. } => Some((center, radius)),
        LightShape::Quad { center, edge_u, edge_v, .. }
        | LightShape::Ellipse { center, edge_u, edge_v, .. }
        | LightShape::Sheared { center, edge_u, edge_v, .. } => {
            Some((center, 0.5 * (edge_u.length() + edge_v.length())))
        }
        LightShape::Sun { .. } => None,
    }
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;
    use relume_scene::{Curves, Points};

    use super::*;

    #[test]
    fn the_recorded_box_holds_lights_hair_and_points_with_room_around_them() {
        let curves = Curves { keys: vec![Vec3::ZERO, Vec3::new(0.0, 0.0, 3.0)], ..Curves::default() };
        let points = Points { positions: vec![Vec3::new(-4.0, 0.0, 0.0)], ..Points::default() };
        let [hair, dust] = [("hair", Geometry::Curves(0)), ("dust", Geometry::Points(0))]
            .map(|(name, geometry)| Instance::new(name, geometry, Affine3A::IDENTITY, vec![]));
        let scene = Scene {
            instances: vec![hair, dust],
            curves: vec![curves],
            points: vec![points],
            ..Scene::default()
        };
        let lamp = |x| LightShape::Sphere { center: Vec3::new(x, 0.0, 0.0), radius: 1.0 };
        let light = Light { name: String::new(), ..Light::unit(lamp(5.0)) };
        let corners = Bounds::of_scene(&scene, &[light]).corners();
        assert_eq!(corners, [Vec3::new(-14.0, -11.0, -11.0), Vec3::new(16.0, 11.0, 13.0)]);
        let is_beyond = |x| reaches_beyond(&lamp(x), corners.map(Vec3::into));
        assert!(!is_beyond(5.0) && !is_beyond(14.5) && is_beyond(15.5) && is_beyond(100.0));
        let sun = LightShape::Sun { direction: Vec3::Z, half_angle: 0.1 };
        assert!(!reaches_beyond(&sun, corners.map(Vec3::into)));
    }

    #[test]
    fn ways_are_cut_to_the_box() {
        let bounds = Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
        let inside = [Vec3::new(-0.5, 0.0, 0.0), Vec3::new(0.5, 0.2, 0.0)];
        assert_eq!(bounds.clip(inside[0], inside[1]), Some(inside));
        let cut = bounds.clip(Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0));
        assert_eq!(cut, Some([Vec3::ZERO, Vec3::X]));
        let through = bounds.clip(Vec3::new(-3.0, 0.5, 0.0), Vec3::new(3.0, 0.5, 0.0));
        assert_eq!(through, Some([Vec3::new(-1.0, 0.5, 0.0), Vec3::new(1.0, 0.5, 0.0)]));
        assert_eq!(bounds.clip(Vec3::new(2.0, 0.0, 0.0), Vec3::new(9.0, 0.0, 0.0)), None);
        assert_eq!(bounds.clip(Vec3::new(-2.0, 2.0, 0.0), Vec3::new(2.0, 2.0, 0.0)), None);
    }
}
