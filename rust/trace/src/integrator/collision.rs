//! Scattering within media.

use glam::Vec3;

use super::{Features, GUIDE_GROUP, Integrator, PathScratch, PathSink, Walk, emission::LitVertex, guided};
use crate::{
    bvh::{Ray, RayKind},
    guide::Guide,
    media::PhaseSample,
    sampler::Draws,
    static_light::LastBounce,
    vertex::Vertex,
};

impl Integrator<'_> {
    /// Sends the path on from a collision in the media of the scratch memory, or says that it ends there.
    pub(super) fn scatter_in_medium<S: PathSink>(
        &self,
        walk: &mut Walk,
        position: Vec3,
        guide: Option<&Guide>,
        scratch: &mut PathScratch,
        features: &mut Features,
        draws: Draws,
        sink: &mut S,
    ) -> bool {
        let limits = &self.settings.bounces;
        features.record_medium(scratch.media.sample.albedo());
        let u = draws.at(0);
        let survival = walk.path.survival(limits);
        if u[3] >= survival {
            return false;
        }
        walk.path.throughput /= survival;
        let travel = walk.ray.direction;
        // Shadow rays use the same memory for the media on their way.
        let medium = std::mem::take(&mut scratch.media.sample);
        let time = walk.ray.time;
        let vertex = Vertex::Medium { position, direction: travel, time, medium: &medium };
        let cones = guided(guide, &vertex, &mut scratch.cones);
        if S::WANTS_STATIC_LIGHT {
            let at = LitVertex { path: &walk.path, route: walk.route.as_ref(), vertex, cones };
            self.add_static_light(at, (&mut scratch.shadow, &mut scratch.media), features, draws);
        }
        if walk.counts {
            sink.meet(|| self.medium_vertex(walk, position, &medium));
        }
        let sample = match cones.map(|cones| (cones, draws.at(GUIDE_GROUP))) {
            Some((cones, v)) => {
                let direction = if v[0] < cones.share {
                    Some(cones.sample([v[1], v[2], v[3]]))
                } else {
                    medium.sample(travel, [u[0], u[1], u[2]]).map(|sample| sample.direction)
                };
                direction.map(|direction| {
                    let (value, pdf) = medium.eval(travel, direction);
                    let pdf = cones.pdf_with(1.0, pdf, direction);
                    PhaseSample { direction, weight: value / pdf, pdf }
                })
            }
            None => medium.sample(travel, [u[0], u[1], u[2]]),
        };
        scratch.media.sample = medium;
        let Some(PhaseSample { direction, weight, pdf }) = sample.filter(|sample| sample.weight.is_finite())
        else {
            return false;
        };
        walk.path.scatter_in_medium(position, weight, pdf, limits);
        if let (Some(media), Some(route)) = (&self.media, &walk.route) {
            walk.path.receiver = media.receiver(&route.stack);
        }
        walk.last = Some(LastBounce { position, pdf });
        let catchers_only = walk.ray.catchers_only;
        walk.ray = Ray { kind: RayKind::Volume, catchers_only, ..Ray::new(position, direction).at(time) };
        walk.begin_segment(position);
        true
    }
}
