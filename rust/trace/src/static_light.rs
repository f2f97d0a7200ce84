//! Direct sampling of what the scene itself emits, for the static layers only: the paths of the dump never use it.
//!
//! Both ways to meet an emitter (a light sample here, the path's own direction) are weighted by the power
//! heuristic (Veach 1997, section 9.2.4). A shadow ray goes straight through transparent surfaces.

use glam::Vec3;
use relume_dump::Lobe;
use relume_scene::{EmitterLinks, ReceiverSet, Scene};

use crate::{
    bsdf::Surface,
    bvh::{Ray, RayKind, SceneBvh},
    emitters::{Emitters, may_be_transparent},
    environment::EnvironmentLight,
    guide::Cones,
    media::ShadowMedia,
    ray_offset::offset_origin,
    shading::{Hit, PreparedMaterials, RayInfo, SurfacePoint},
    vertex::Vertex,
};

/// Contribution below which shadow rays are left to chance: Cycles' default.
const LIGHT_THRESHOLD: f32 = 0.01;

/// Emitters and the environment, with how likely each is sampled.
#[derive(Debug)]
pub(crate) struct StaticLights {
    emitters: Option<Emitters>,
    samples_environment: bool,
}

/// Instances that let shadow rays through.
#[derive(Debug)]
pub(crate) struct SeeThrough {
    /// For each instance: whether any of its materials does.
    by_instance: Vec<bool>,
    any: bool,
}

impl SeeThrough {
    /// Those of a scene.
    pub fn new(scene: &Scene) -> Self {
        let by_material: Vec<bool> = (scene.materials.iter())
            .map(|material| may_be_transparent(material) && !material.opaque_shadows)
            .collect();
        let by_instance: Vec<bool> = scene
            .instances
            .iter()
            .map(|instance| instance.materials.iter().any(|m| by_material.get(*m) == Some(&true)))
            .collect();
        Self { any: by_instance.contains(&true), by_instance }
    }
}

/// Contribution of a light sample to the static layers, before the path's throughput.
#[derive(Clone, Copy, Debug)]
pub(crate) enum StaticSample {
    Emission(Vec3),
    World(Vec3),
}

/// Position of the last non-transparent bounce, and the density of its direction: the weight of a hit needs them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LastBounce {
    pub position: Vec3,
    pub pdf: f32,
}

impl StaticLights {
    /// Sampler of static lights; nothing if there is nothing to sample, nor light that Fast GI adds.
    pub fn new(
        scene: &Scene,
        materials: &PreparedMaterials,
        environment: &EnvironmentLight,
        fast_gi_adds: bool,
    ) -> Option<Self> {
        let emitters = Emitters::new(scene, materials);
        let samples_environment = environment.can_sample();
        (emitters.is_some() || samples_environment || fast_gi_adds)
            .then_some(Self { emitters, samples_environment })
    }

    /// Probability to sample the environment rather than an emitter.
    fn environment_share(&self) -> f32 {
        match (self.samples_environment, &self.emitters) {
            (false, _) => 0.0,
            (true, Some(_)) => 0.5,
            (true, None) => 1.0,
        }
    }

    /// Weight of emission that the path met on a triangle. Where not everything blocks its light, only light samples count.
    pub fn emission_weight(&self, last: Option<LastBounce>, scene: &Scene, point: &SurfacePoint) -> f32 {
        let (Some(last), Some(emitters)) = (last, &self.emitters) else { return 1.0 };
        let links = scene.instances[point.instance as usize].links.as_ref();
        if links.is_some_and(|links| links.blockers.is_some()) && emitters.have(point) {
            return 0.0;
        }
        let towards = point.position - last.position;
        let cos = point.geometric_normal.dot(point.wo).abs();
        let density =
            emitters.area_density(scene, point) * (1.0 - self.environment_share()) * towards.length_squared()
                / cos.max(f32::MIN_POSITIVE);
        power_heuristic(last.pdf, density)
    }

    /// Weight of the world that the path met in `direction`.
    pub fn world_weight(
        &self,
        last: Option<LastBounce>,
        environment: &EnvironmentLight,
        direction: Vec3,
    ) -> f32 {
        let Some(last) = last.filter(|_| self.samples_environment) else { return 1.0 };
        power_heuristic(last.pdf, environment.density(direction) * self.environment_share())
    }

    /// One light sample for `vertex`, before the path's throughput. That times film exposure, `on_film`, decides whether it is worth a
    /// shadow ray.
    pub fn sample_direct(
        &self,
        tracer: &mut ShadowTracer<'_>,
        vertex: Vertex<'_>,
        scratch: &mut Surface,
        on_film: Vec3,
        u: [f32; 4],
    ) -> Option<StaticSample> {
        let share = self.environment_share();
        if u[3] < share {
            let (direction, density) = tracer.environment.sample([u[0], u[1], u[2]])?;
            let factor = tracer.weighted(vertex, direction, density * share, true)?;
            let radiance =
                tracer.environment.radiance(tracer.scene, tracer.materials, direction, Lobe::Diffuse);
            let factor = factor / survival(on_film * factor * radiance, u[3] / share)?;
            let through = tracer.transmittance_of(vertex, direction, Goal::open(f32::INFINITY), scratch)?;
            return Some(StaticSample::World(factor * radiance * through));
        }
        let target = self.emitters.as_ref()?.sample([u[0], u[1], u[2]], tracer.scene, vertex.time());
        let towards = target.position - vertex.position();
        let distance_squared = towards.length_squared();
        let direction = towards.try_normalize()?;
        let cos = target.normal.dot(direction).abs();
        let density = target.area_density * (1.0 - share) * distance_squared / cos;
        let links = tracer.scene.instances[target.instance as usize].links.as_deref();
        if links.is_some_and(|links| !links.light(tracer.receiver)) {
            return None;
        }
        let blockers = links.filter(|links| links.blockers.is_some());
        let factor = tracer.weighted(vertex, direction, density, blockers.is_none())?;
        let factor = factor / survival(on_film * factor * target.brightness, (u[3] - share) / (1.0 - share))?;
        let goal = Goal::Emitter { triangle: (target.instance, target.triangle), links: blockers };
        let through = tracer.transmittance_of(vertex, direction, goal, scratch)?;
        Some(StaticSample::Emission(factor * through * scratch.emission()))
    }

    /// Light of radiance 1 from all sides that diffuse closures of a vertex scatter, as far as nothing within a `reach` in metres
    /// blocks it.
    pub fn sample_open(
        &self,
        tracer: &mut ShadowTracer<'_>,
        vertex: Vertex<'_>,
        reach: f32,
        scratch: &mut Surface,
        u: [f32; 2],
    ) -> Option<Vec3> {
        let Vertex::Surface { surface, .. } = vertex else { return None };
        let (weight, direction) = surface.scatter_open_light(u)?;
        Some(weight * tracer.transmittance_of(vertex, direction, Goal::open(reach), scratch)?)
    }
}

/// Where a shadow ray goes.
#[derive(Clone, Copy)]
pub(crate) enum Goal<'a> {
    /// Open space up to `reach` metres, beyond which nothing blocks the ray; `blockers` alone do, where there are any.
    Open { reach: f32, blockers: Option<&'a ReceiverSet> },
    /// To an instance's triangle that shines; links where not everything blocks its light.
    Emitter { triangle: (u32, u32), links: Option<&'a EmitterLinks> },
}

impl Goal<'_> {
    /// Open space up to so many metres, where all objects block the ray.
    fn open(reach: f32) -> Self {
        Self::Open { reach, blockers: None }
    }

    fn triangle(&self) -> Option<(u32, u32)> {
        match self {
            Self::Open { .. } => None,
            Self::Emitter { triangle, .. } => Some(*triangle),
        }
    }

    fn reach(&self) -> f32 {
        match self {
            Self::Open { reach, .. } => *reach,
            Self::Emitter { .. } => f32::INFINITY,
        }
    }

    /// True if all objects block the ray.
    fn is_plain(&self) -> bool {
        matches!(self, Self::Open { blockers: None, .. })
    }

    /// True if an instance does not block the ray.
    fn ignores(&self, scene: &Scene, instance: u32) -> bool {
        let receiver = scene.instances[instance as usize].receiver;
        match self {
            Self::Open { blockers, .. } => blockers.is_some_and(|blockers| !blockers.contains(receiver)),
            Self::Emitter { links, .. } => links.is_some_and(|links| links.ignore(receiver)),
        }
    }
}

/// Scene access of a shadow ray.
pub(crate) struct ShadowTracer<'a> {
    pub scene: &'a Scene,
    pub bvh: &'a SceneBvh,
    pub materials: &'a PreparedMaterials,
    pub environment: &'a EnvironmentLight,
    pub see_through: &'a SeeThrough,
    /// The path's ray, which met the vertex.
    pub ray: RayInfo,
    /// The vertex's number for light linking.
    pub receiver: u16,
    /// Cones that the path's own directions are drawn from beside the surface.
    pub cones: Option<&'a Cones>,
    /// Number of transparent surfaces that may lie before a light.
    pub transparent_left: u32,
    /// True if only shadow catchers stand before a light.
    pub catchers_only: bool,
    /// The media around the vertex, if there are any in the scene.
    pub media: Option<ShadowMedia<'a>>,
}

impl ShadowTracer<'_> {
    /// [`Self::transmittance`] from a vertex.
    fn transmittance_of(
        &mut self,
        vertex: Vertex<'_>,
        direction: Vec3,
        goal: Goal<'_>,
        scratch: &mut Surface,
    ) -> Option<Vec3> {
        if let Some(media) = &mut self.media {
            media.leave_vertex(vertex, direction);
        }
        let ray = Ray { kind: RayKind::Shadow, catchers_only: self.catchers_only, ..vertex.ray(direction) };
        self.transmittance(ray, vertex.position(), goal, scratch)
    }

    /// Share of light that comes straight from `goal` to a vertex at `origin`, from where a shadow ray starts; nothing if something is
    /// in between. Leaves an emitter's surface in `scratch`.
    pub fn transmittance(
        &mut self,
        mut ray: Ray,
        origin: Vec3,
        goal: Goal<'_>,
        scratch: &mut Surface,
    ) -> Option<Vec3> {
        let mut through = Vec3::ONE;
        ray.t_max = goal.reach();
        let emitter = goal.triangle();
        if goal.is_plain() && !self.see_through.any && self.media.is_none() {
            return (!self.bvh.is_blocked(&ray)).then_some(through);
        }
        let shadow = self.ray.shadow_from(origin);
        let mut passed = 0;
        while passed <= self.transparent_left {
            let hit = self.bvh.intersect(&ray);
            if let Some(media) = &mut self.media {
                through *= media.transmittance(&ray, hit.as_ref());
                if through.max_element() <= 0.0 {
                    return None;
                }
                if hit.is_some_and(|hit| media.pass_hull(&mut ray, &hit)) {
                    continue;
                }
            }
            let Some(hit) = hit else { return emitter.is_none().then_some(through) };
            let met = (hit.instance, hit.primitive);
            if emitter == Some(met) {
                self.shade(&ray, &hit, self.ray.to_emitter(origin), scratch);
                return Some(through);
            }
            let is_ignored = goal.ignores(self.scene, hit.instance);
            let surface_point = if is_ignored {
                self.materials.surface_point(self.scene, &hit, ray.origin, ray.direction, 0.0)
            } else {
                if !self.see_through.by_instance[hit.instance as usize] {
                    return None;
                }
                let passed_ray = RayInfo { transparent_depth: shadow.transparent_depth + passed, ..shadow };
                passed += 1;
                let surface_point = self.shade(&ray, &hit, passed_ray, scratch);
                through *= scratch.transparency();
                if through.max_element() <= 0.0 {
                    return None;
                }
                surface_point
            };
            if let Some(media) = self.media.as_mut().filter(|_| !is_ignored) {
                media.cross(&hit, ray.direction);
            }
            ray.t_max -= hit.distance;
            offset_origin(&mut ray, &surface_point);
        }
        None
    }

    fn shade(&self, ray: &Ray, hit: &Hit, info: RayInfo, surface: &mut Surface) -> SurfacePoint {
        let met = self.materials.surface_point(self.scene, hit, ray.origin, ray.direction, 0.0);
        let point = SurfacePoint { ray: info, ..met };
        self.materials.evaluate(self.scene, &point, surface);
        point
    }

    /// `f |cos| / density`, weighted against the path's own directions if those find the light, too; nothing if the vertex
    /// sends no light that way.
    fn weighted(
        &self,
        vertex: Vertex<'_>,
        direction: Vec3,
        density: f32,
        is_found_by_paths: bool,
    ) -> Option<Vec3> {
        let (value, pdf) = vertex.eval(direction)?;
        let pdf = self.cones.map_or(pdf, |cones| cones.pdf_with(vertex.dull_share(), pdf, direction));
        let weight = if is_found_by_paths { power_heuristic(density, pdf) } else { 1.0 };
        let factor = value * (weight / density);
        (factor.is_finite() && factor.max_element() > 0.0).then_some(factor)
    }
}

/// Probability of a shadow ray for a light that adds up to `contribution` to the film, if the number `u` is below it. Weak
/// lights get few, as with Cycles' `light_sampling_threshold`, which it, too, divides by the film's exposure.
fn survival(contribution: Vec3, u: f32) -> Option<f32> {
    let probability = (contribution.max_element() / LIGHT_THRESHOLD).min(1.0);
    (u < probability).then_some(probability)
}

fn power_heuristic(this: f32, other: f32) -> f32 {
    if other == 0.0 {
        return 1.0;
    }
    let ratio = other / this;
    1.0 / (1.0 + ratio * ratio)
}
