//! Participating media: what is inside of closed meshes, and in all space.
//!
//! A path carries a [`VolumeStack`] of the media around it. Between two surfaces a [`Flight`] through them ends at a collision or at
//! the next surface. Extinction that is the same in all channels is analog: free flight has the density of the transmittance, so that a
//! segment of the dump carries the weight that it starts with, and any light along it counts with what is left of its light on the
//! way. Where channels differ, collisions with fictitious matter become records, at which the weight changes (Kutz et al. 2017, "Spectral and
//! Decomposition Tracking for Rendering Heterogeneous Volumes").

mod bounds;
mod crossing;
mod flight;
mod grid_majorants;
mod inversion;
mod majorant;
mod phase;
mod sample;
mod shadow;
mod stack;

use std::{
    cell::RefCell,
    collections::HashMap,
    sync::{Arc, OnceLock},
};

use glam::{Affine3A, Vec3, Vec4};
use relume_scene::{Light, STILL, Scene};

pub(crate) use bounds::Bounds;
pub use bounds::reaches_beyond;
pub(crate) use crossing::HullCrossing;
pub(crate) use flight::{Flight, Landing, TrackingNumbers};
use majorant::{GridRay, MajorantGrid};
pub use phase::Phase;
pub use sample::MediumSample;
pub(crate) use sample::PhaseSample;
pub(crate) use shadow::ShadowMedia;
use stack::DEEPEST;
pub(crate) use stack::VolumeStack;

use crate::shading::{Hit, MediumPoint, PreparedMaterials, RayInfo};

/// Objects with media among which it is looked for more than can overlap; each is compared with each.
const MOST_CHECKED: usize = 2048;

/// All media of a scene, made ready.
#[derive(Debug)]
pub(crate) struct Media {
    media: Vec<Medium>,
    /// Number of the medium of an instance and a material.
    numbers: HashMap<(u32, u32), u32>,
    /// True for each material that has a volume and no surface.
    hulls: Vec<bool>,
    /// Medium that fills all space.
    world: Option<u32>,
    /// Box of all objects with a medium.
    inside: Bounds,
    /// Box beyond which nothing is recorded; none without a medium that fills all space.
    recorded: Option<Bounds>,
}

/// The medium of one instance, or of all space.
#[derive(Debug)]
struct Medium {
    /// See [`MediumPoint::instance`].
    instance: u32,
    material: usize,
    receiver: u16,
    glows: bool,
    /// True if it differs from place to place.
    varies: bool,
    /// True if it differs from ray to ray.
    asks_light_path: bool,
    /// The medium at each point of it for all rays; nothing if it varies.
    homogeneous: Option<Arc<MediumSample>>,
    /// Bounds of its extinction, where it varies. They are made when a ray is first in it.
    majorants: OnceLock<MajorantGrid>,
}

/// Scene, and media in it.
#[derive(Clone, Copy)]
pub(crate) struct MediaSpace<'a> {
    pub scene: &'a Scene,
    pub materials: &'a PreparedMaterials,
    pub media: &'a Media,
    /// Time within the shutter's interval.
    pub time: f32,
    /// The ray that passes the media.
    pub ray: RayInfo,
}

/// Memory that one thread reuses.
#[derive(Clone, Debug, Default)]
pub(crate) struct MediaScratch {
    /// The media at the last collision.
    pub sample: MediumSample,
    /// Media at other points.
    pub other: MediumSample,
    /// Values of shader nodes.
    pub values: Vec<Vec4>,
}

impl Media {
    /// The media of a scene; nothing if it has none. `lights` are those that are surely to be met. Adds to `warnings` what is left
    /// out.
    pub fn new(
        scene: &Scene,
        materials: &PreparedMaterials,
        lights: &[Light],
        warnings: &mut Vec<String>,
    ) -> Option<Self> {
        let has_medium: Vec<bool> =
            (0..scene.materials.len()).map(|material| materials.graph(material).volume.is_some()).collect();
        let hulls = scene.materials.iter().zip(&has_medium).map(|(m, has)| m.is_hull() && *has).collect();
        let mut found = Self {
            media: Vec::new(),
            numbers: HashMap::new(),
            hulls,
            world: None,
            inside: Bounds::EMPTY,
            recorded: None,
        };
        let mut boxes = Vec::new();
        for (number, instance) in scene.instances.iter().enumerate() {
            for material in instance.materials.iter().copied().filter(|material| has_medium[*material]) {
                found.add(scene, materials, number, material, instance.receiver);
                let bounds = Bounds::of_instance(scene, instance);
                found.inside = found.inside.with(bounds);
                boxes.push((bounds, &instance.name));
            }
        }
        if let Some(name) = most_nested(&boxes) {
            let words =
                format!("more than {DEEPEST} volumes overlap there; as in Cycles, further ones are left out");
            warnings.push(format!("object '{name}': {words}"));
        }
        let world = scene.world.volume.filter(|material| has_medium[*material]);
        if let Some(material) = world {
            let number = found.add(scene, materials, scene.instances.len(), material, scene.world.receiver);
            found.world = Some(number);
            found.recorded = Some(Bounds::of_scene(scene, lights));
        }
        // Not when a ray is first in it: they are found in parallel, and who waits may be needed for that.
        for medium in found.media.iter().filter(|medium| medium.homogeneous.is_none()) {
            let space = MediaSpace { scene, materials, media: &found, time: STILL, ray: RayInfo::default() };
            if let Some(bounds) = grid_majorants::of_grids(&space, medium) {
                medium.majorants.get_or_init(|| bounds);
            }
        }
        (!found.media.is_empty()).then_some(found)
    }

    fn add(
        &mut self,
        scene: &Scene,
        materials: &PreparedMaterials,
        instance: usize,
        material: usize,
        receiver: u16,
    ) -> u32 {
        let instance = instance as u32;
        *self.numbers.entry((instance, material as u32)).or_insert_with(|| {
            let graph = materials.graph(material);
            let has_field = |name| materials.field(scene, (instance, STILL), name, Vec3::ZERO).is_some();
            let varies = graph.medium_varies() || graph.medium_fields().into_iter().any(has_field);
            let asks_light_path = graph.medium_asks_light_path();
            let homogeneous = (!varies && !asks_light_path).then(|| {
                let mut sample = MediumSample::default();
                let ray = RayInfo::default();
                let point = MediumPoint { position: Vec3::ZERO, wo: Vec3::Z, instance, time: STILL, ray };
                materials.evaluate_medium(scene, material, &point, &[], &mut Vec::new(), &mut sample);
                Arc::new(sample)
            });
            self.media.push(Medium {
                instance,
                material,
                receiver,
                glows: graph.medium_glows(),
                varies,
                asks_light_path,
                homogeneous,
                majorants: OnceLock::new(),
            });
            self.media.len() as u32 - 1
        })
    }

    /// The media of a stack together, if there are any and each is homogeneous.
    pub fn homogeneous(&self, stack: &VolumeStack) -> Option<Arc<MediumSample>> {
        let mut media = stack.media().iter().map(|medium| self.media[*medium as usize].homogeneous.as_ref());
        let mut sum = Arc::clone(media.next()??);
        for medium in media {
            Arc::make_mut(&mut sum).add(medium?);
        }
        Some(sum)
    }

    /// True if some medium differs from ray to ray.
    pub fn ask_light_path(&self) -> bool {
        self.media.iter().any(|medium| medium.asks_light_path)
    }

    /// Space as a path finds it that starts outside of all objects.
    pub fn outside(&self) -> VolumeStack {
        VolumeStack::new(self.world)
    }

    /// True if a point can be inside of an object with a medium.
    pub fn may_be_inside(&self, point: Vec3) -> bool {
        self.inside.contains(point)
    }

    /// Box beyond which no record ends, see [`Bounds::of_scene`].
    pub fn recorded(&self) -> Option<&Bounds> {
        self.recorded.as_ref()
    }

    /// True if a ray only goes into or out of a medium where it meets a triangle.
    pub fn is_hull(&self, scene: &Scene, hit: &Hit) -> bool {
        let material = scene.instances[hit.instance as usize].material_of(scene, hit.primitive as usize);
        material.is_some_and(|material| self.hulls[material])
    }

    /// Takes a ray along `direction` through a surface that it hit.
    pub fn cross(&self, scene: &Scene, hit: &Hit, direction: Vec3, stack: &mut VolumeStack) {
        self.cross_at(scene, (hit.instance, hit.primitive), hit.front.dot(direction) > 0.0, stack);
    }

    /// Takes a ray through a triangle, out of what is behind it if it `leaves`.
    pub fn cross_at(&self, scene: &Scene, triangle: (u32, u32), leaves: bool, stack: &mut VolumeStack) {
        match self.number(scene, triangle) {
            Some(medium) if leaves => stack.leave(medium),
            Some(medium) => stack.enter(medium),
            None => {}
        }
    }

    /// Number of the medium behind a triangle of an instance.
    pub fn number(&self, scene: &Scene, (instance, triangle): (u32, u32)) -> Option<u32> {
        let material = scene.instances[instance as usize].material_of(scene, triangle as usize)?;
        self.numbers.get(&(instance, material as u32)).copied()
    }

    /// Number of the object that what scatters in these media belongs to, for light linking: the outermost, as in Cycles.
    pub fn receiver(&self, stack: &VolumeStack) -> u16 {
        stack.media().first().map_or(0, |medium| self.media[*medium as usize].receiver)
    }
}

/// Name of a medium in whose middle there are more others than a stack can hold, judged by their boxes.
fn most_nested<'s>(boxes: &[(Bounds, &'s String)]) -> Option<&'s String> {
    let checked = &boxes[..boxes.len().min(MOST_CHECKED)];
    let is_crowded =
        |middle: Vec3| checked.iter().filter(|(other, _)| other.contains(middle)).count() > DEEPEST;
    checked.iter().find(|(bounds, _)| is_crowded(bounds.middle())).map(|(_, name)| *name)
}

impl Medium {
    /// Rays that between them meet as much of it as any does.
    fn rays(&self) -> Vec<RayInfo> {
        if self.asks_light_path { RayInfo::of_each_kind() } else { vec![RayInfo::default()] }
    }
}

impl MediaSpace<'_> {
    /// Adds one of the media at a point.
    fn add_medium(
        &self,
        medium: &Medium,
        position: Vec3,
        direction: Vec3,
        values: &mut Vec<Vec4>,
        sample: &mut MediumSample,
    ) {
        match &medium.homogeneous {
            Some(homogeneous) => sample.add(homogeneous),
            None => {
                let (instance, time, ray) = (medium.instance, self.time, self.ray);
                let point = MediumPoint { position, wo: -direction, instance, time, ray };
                self.materials.evaluate_medium(self.scene, medium.material, &point, &[], values, sample);
            }
        }
    }

    /// Fills `sample` with the media of a stack at a point.
    fn fill(
        &self,
        stack: &VolumeStack,
        position: Vec3,
        direction: Vec3,
        values: &mut Vec<Vec4>,
        sample: &mut MediumSample,
    ) {
        sample.clear();
        for medium in stack.media() {
            self.add_medium(&self.media.media[*medium as usize], position, direction, values, sample);
        }
    }

    /// A ray through the bounds of a medium that varies.
    fn majorant_ray(&self, medium: &Medium, origin: Vec3, direction: Vec3) -> GridRay {
        let bounds = self.majorants(medium);
        if !self.materials.is_moving(medium.instance) {
            return bounds.ray(origin, direction);
        }
        // The bounds are those of the object in the middle of the interval, and move with it.
        let world_from_object = self.scene.instances[medium.instance as usize].world_from_object;
        let to_still = world_from_object * self.materials.object_from_world(medium.instance, self.time);
        bounds.ray(to_still.transform_point3(origin), to_still.transform_vector3(direction))
    }

    /// Bounds of a medium that varies.
    fn majorants<'m>(&self, medium: &'m Medium) -> &'m MajorantGrid {
        medium.majorants.get_or_init(|| {
            let rays = medium.rays();
            let memory = RefCell::new((MediumSample::default(), Vec::new()));
            let extinction = |position: Vec3| {
                let (sample, values) = &mut *memory.borrow_mut();
                let of_ray = |ray: &RayInfo| {
                    sample.clear();
                    let still = Self { time: STILL, ray: *ray, ..*self };
                    still.add_medium(medium, position, Vec3::NEG_Z, values, sample);
                    sample.extinction.max_element()
                };
                rays.iter().map(of_ray).fold(0.0, f32::max)
            };
            if !medium.varies {
                return MajorantGrid::even(extinction(Vec3::ZERO));
            }
            let instance = self.scene.instances.get(medium.instance as usize);
            let (local_from_world, bounds) = match instance {
                Some(instance) => {
                    let bounds = Bounds::of_geometry(self.scene, instance.geometry);
                    (self.materials.object_from_world(medium.instance, STILL), bounds)
                }
                None => (Affine3A::IDENTITY, self.media.recorded.unwrap_or(Bounds::EMPTY)),
            };
            MajorantGrid::sampled(local_from_world, bounds.corners(), instance.is_some(), extinction)
        })
    }
}
