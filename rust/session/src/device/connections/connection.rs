//! A point on a light at a vertex.

use glam::Vec3;
use relume_dump::ByConnectedLobe;
use relume_gather::{Emitter, LightSample};
use relume_trace::{ConnectScratch, LightCenter, ShadowTarget, Tracer, UnpackedVertex, VertexPlace};

/// Least share of a light that is connected at each vertex. Below it, fewer vertices are connected in its place.
const LEAST_SHARE: f32 = 0.1;

/// Light of one point on a light at a vertex, as it adds to the pixel, by numbers in 0..1.
pub(crate) fn connect(
    tracer: &Tracer<'_>,
    vertex: &UnpackedVertex<'_>,
    light: &Emitter,
    numbers: [f32; 4],
    scratch: &mut ConnectScratch,
) -> Vec3 {
    let Some(found) = Connection::new(vertex, light, numbers) else { return Vec3::ZERO };
    found.light(tracer, found.weights, scratch)
}

/// A vertex and a point on a light.
pub(super) struct Connection<'a> {
    vertex: &'a UnpackedVertex<'a>,
    light: &'a Emitter,
    place: VertexPlace,
    sample: LightSample,
    /// Shares of its light that count, for each of [`relume_dump::Lobe::CONNECTED`].
    pub weights: ByConnectedLobe<f32>,
    numbers: [f32; 4],
}

impl<'a> Connection<'a> {
    /// Chooses a point by numbers in 0..1; nothing if none of the light counts.
    pub fn new(vertex: &'a UnpackedVertex<'a>, light: &'a Emitter, numbers: [f32; 4]) -> Option<Self> {
        let [u, v, chance, w] = numbers;
        let (counts, factors) = (vertex.lobes(), light.factors(vertex.packed.receiver()));
        let lobes = (0..counts.len()).filter(|lobe| counts[*lobe] && factors[*lobe] != 0.0);
        lobes.clone().next()?;
        let center = light.center().map(|(position, radius)| LightCenter { position, radius });
        let place = vertex.packed.place(center, w)?;
        let sample = light.sample(place.position, vertex.normal(), [u, v])?;
        let shares = light.shares(place.position, sample.direction);
        let most = lobes.clone().map(|lobe| shares[lobe]).fold(0.0, f32::max);
        if most <= chance * LEAST_SHARE {
            return None;
        }
        let scale = (LEAST_SHARE / most).max(1.0);
        let mut weights = ByConnectedLobe::default();
        lobes.for_each(|lobe| weights[lobe] = scale * shares[lobe] * factors[lobe]);
        Some(Self { vertex, light, place, sample, weights, numbers })
    }

    /// Light there by weights for each of [`relume_dump::Lobe::CONNECTED`].
    pub fn light(
        &self,
        tracer: &Tracer<'_>,
        weights: ByConnectedLobe<f32>,
        scratch: &mut ConnectScratch,
    ) -> Vec3 {
        let LightSample { direction, distance, radiance } = self.sample;
        let target = ShadowTarget { direction, distance, blockers: self.light.blockers() };
        radiance * tracer.connect(self.vertex, self.place, target, weights, self.numbers, scratch)
    }
}
