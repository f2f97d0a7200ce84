//! Light by connection: shadow rays from vertices of light-free paths to points on a light.
//!
//! A segment that leaves a dull surface or a medium crosses a small light seldom. What it collects on average has a closed form,
//! though: the integral of scattering, radiance and visibility over the light. So light of [`relume_dump::Lobe::CONNECTED`] can be summed
//! over vertices in place of crossings (next event estimation of paths that were traced before); all other lobes are summed over
//! crossings. Both together have the same mean as crossings alone.

mod equiangular;
mod vertex;

use glam::Vec3;
use relume_dump::{AovSample, ByConnectedLobe, Pass, Segment};
use relume_scene::ReceiverSet;

pub use self::equiangular::LightCenter;
pub(crate) use self::vertex::{HomogeneousFlight, PathAtVertex};
pub use self::vertex::{PathVertex, UnpackedVertex, VertexPlace};
use crate::{
    bsdf::Surface,
    integrator::{PathScratch, PathSink},
    media::{HullCrossing, Media, MediaScratch, MediaSpace, ShadowMedia, TrackingNumbers, VolumeStack},
    render::Tracer,
    static_light::{Goal, ShadowTracer},
};

/// Most vertices that are kept of a pixel. Where there are more, those that matter more are kept more often, and weigh as
/// much more as they are kept seldom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VertexLimits {
    /// Vertices before which nothing scattered the path: their light is direct.
    pub first: usize,
    /// All others.
    pub later: usize,
}

/// Vertices of the paths of some pixels.
#[derive(Debug, Default)]
pub struct PixelVertices {
    /// First vertex of each pixel, then the number of vertices.
    offsets: Vec<usize>,
    vertices: Vec<PathVertex>,
}

impl PixelVertices {
    /// Vertices of a pixel, by its number among the others. Their light adds up to the sum over the pixel's paths.
    pub fn pixel(&self, pixel: usize) -> &[PathVertex] {
        &self.vertices[self.offsets[pixel]..self.offsets[pixel + 1]]
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.offsets[..]) + self.vertices.iter().map(PathVertex::bytes).sum::<usize>()
    }
}

/// End of a shadow ray.
#[derive(Clone, Copy, Debug)]
pub struct ShadowTarget<'a> {
    /// Unit direction there.
    pub direction: Vec3,
    /// Metres; infinite outside of the scene.
    pub distance: f32,
    /// The only objects that block the ray, by their receiver numbers; none where all do.
    pub blockers: Option<&'a ReceiverSet>,
}

/// Memory that one thread reuses from shadow ray to shadow ray.
#[derive(Debug, Default)]
pub struct ConnectScratch {
    surface: Surface,
    media: MediaScratch,
}

/// Groups of the sampler that choose vertices.
const CHOICE_GROUP: u32 = (1 << 26) + 1;

impl Tracer<'_> {
    /// Vertices of the paths of some pixels.
    pub fn path_vertices(
        &self,
        pixels: impl IntoIterator<Item = (usize, usize)>,
        pass: Pass,
        limits: VertexLimits,
        scratch: &mut PathScratch,
    ) -> PixelVertices {
        let mut kept = PixelVertices::default();
        let mut met = MetVertices::default();
        for (x, y) in pixels {
            kept.offsets.push(kept.vertices.len());
            self.trace_guided((x, y), pass, None, scratch, &mut met);
            let [first, later, ..] = self.sampler((x, y)).draw(pass.first_sample, CHOICE_GROUP);
            choose(&mut met.first, limits.first, first, &mut kept.vertices);
            choose(&mut met.later, limits.later, later, &mut kept.vertices);
        }
        kept.offsets.push(kept.vertices.len());
        kept
    }

    /// Contribution to the pixel of a vertex at a place of it, RGB, of light from a target of radiance `factors` per steradian for
    /// each of [`relume_dump::Lobe::CONNECTED`]. The numbers in 0..1 decide about its way through media.
    pub fn connect(
        &self,
        vertex: &UnpackedVertex<'_>,
        place: VertexPlace,
        ShadowTarget { direction, distance, blockers }: ShadowTarget<'_>,
        factors: ByConnectedLobe<f32>,
        numbers: [f32; 4],
        scratch: &mut ConnectScratch,
    ) -> Vec3 {
        let Some((scattered, ray)) = vertex.scatter(place, direction, factors) else { return Vec3::ZERO };
        if blockers.is_some_and(|blockers| blockers.receivers.is_empty()) {
            // Media do not dim lights without shadow either.
            return scattered;
        }
        let integrator = &self.integrator;
        let media = integrator.media.as_ref();
        let mut tracer = ShadowTracer {
            scene: integrator.scene,
            bvh: &integrator.bvh,
            materials: &integrator.materials,
            environment: &integrator.environment,
            see_through: &integrator.see_through,
            ray: vertex.packed.ray_info(),
            receiver: vertex.packed.receiver(),
            cones: None,
            transparent_left: vertex.packed.transparent_left(),
            catchers_only: false,
            media: media.map(|media| {
                self.shadow_media(media, (vertex, place, direction), numbers, &mut scratch.media)
            }),
        };
        let goal = Goal::Open { reach: distance, blockers };
        let through = tracer.transmittance(ray, place.position, goal, &mut scratch.surface);
        through.map_or(Vec3::ZERO, |through| scattered * through)
    }

    /// Media on the way of a shadow ray from a vertex in a unit direction.
    fn shadow_media<'s>(
        &'s self,
        media: &'s Media,
        (vertex, place, direction): (&UnpackedVertex<'_>, VertexPlace, Vec3),
        [u, v, _, w]: [f32; 4],
        scratch: &'s mut MediaScratch,
    ) -> ShadowMedia<'s> {
        let ray = vertex.packed.ray_info().shadow_from(place.position);
        let (scene, materials) = (self.integrator.scene, &self.integrator.materials);
        let mut stack = vertex.packed.around().map_or_else(|| media.outside(), VolumeStack::of);
        if let Some((triangle, leaves)) = vertex.comes_through(direction) {
            media.cross_at(scene, triangle, leaves, &mut stack);
        }
        ShadowMedia {
            space: MediaSpace { scene, materials, media, time: vertex.packed.time(), ray },
            stack,
            crossing: HullCrossing::default(),
            numbers: TrackingNumbers::seeded([u, v, w]),
            scratch,
        }
    }
}

/// Vertices of a pixel as its paths meet them: the first of their paths, and all others.
#[derive(Debug, Default)]
struct MetVertices {
    first: Vec<PathVertex>,
    later: Vec<PathVertex>,
}

/// Keeps at most `limit` of some vertices, by systematic sampling of their importance. The number `u` is in 0..1.
fn choose(met: &mut Vec<PathVertex>, limit: usize, u: f32, kept: &mut Vec<PathVertex>) {
    if met.len() <= limit {
        kept.append(met);
        return;
    }
    let importance: Vec<f32> = met.iter().map(PathVertex::importance).collect();
    let step = importance.iter().sum::<f32>() / limit as f32;
    let (mut sum, mut next) = (0.0, u * step);
    for (vertex, importance) in met.drain(..).zip(importance) {
        sum += importance;
        let times = ((sum - next) / step).ceil().max(0.0);
        if times > 0.0 {
            next += times * step;
            kept.push(vertex.scaled(times * step / importance));
        }
    }
}

impl PathSink for MetVertices {
    const WANTS_STATIC_LIGHT: bool = false;

    fn begin_path(&mut self, _camera_vertex: Option<Vec3>) {}

    fn push(&mut self, _segment: Segment) {}

    fn end_path(&mut self, _aovs: AovSample) {}

    fn meet(&mut self, vertex: impl FnOnce() -> Option<PathVertex>) {
        let Some(vertex) = vertex() else { return };
        if vertex.is_first() { self.first.push(vertex) } else { self.later.push(vertex) }
    }
}
