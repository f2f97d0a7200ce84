//! Rays of shader nodes that look around.

use super::Integrator;
use crate::{
    path::PathState,
    sampler::Draws,
    shading::{Probes, SurfacePoint},
};

impl Integrator<'_> {
    /// Rays for nodes that look around from a vertex; nothing if there are no such nodes.
    pub(crate) fn probes<'a>(
        &'a self,
        path: &PathState,
        point: &'a SurfacePoint,
        draws: Draws,
    ) -> Option<Probes<'a>> {
        let min_pdf = path.min_pdf;
        self.materials.looks_around.then_some(Probes { bvh: &self.bvh, point, draws, min_pdf })
    }
}
