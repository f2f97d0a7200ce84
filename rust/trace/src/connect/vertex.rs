use std::sync::Arc;

use glam::Vec3;
use relume_dump::{decode_direction, encode_direction};

use super::ShadowStart;
use crate::{
    bsdf::{DiffuseClosures, DiffusePart, SideNormals, Surface, lambert},
    bvh::Ray,
    shading::{RayInfo, SurfacePoint},
};

/// Vertex of a light-free path on a surface that reflects diffusely.
#[derive(Clone, Debug)]
pub struct DiffuseVertex {
    /// World space, metres.
    pub position: Vec3,
    /// Number that lights go by ([`relume_dump::Segment::receiver`]).
    pub receiver: u16,
    /// True if no event that scattered the path came before.
    pub is_first: bool,
    pub(super) start: ShadowStart,
    /// Weight on the film of what is reflected. The sum of Lambert's closures is part of it.
    weight: Vec3,
    /// Octahedral normals: the surface's own, the interpolated one, and that of the closures.
    geometric: u32,
    shading: u32,
    normal: u32,
    /// The closures, if they are not Lambert's.
    closures: Option<Arc<DiffuseClosures>>,
}

impl DiffuseVertex {
    /// Vertex where a path of the weight `throughput` met a surface, whose receiver number holds its class; nothing if the
    /// surface reflects nothing diffusely.
    pub(crate) fn new(
        (point, surface): (&SurfacePoint, &Surface),
        throughput: Vec3,
        receiver: u16,
        is_first: bool,
        start: ShadowStart,
    ) -> Option<Self> {
        let (weight, normal, closures) = match surface.diffuse_part()? {
            DiffusePart::Lambert { weight, normal } => (weight, normal, None),
            DiffusePart::Closures(of_point) => {
                (Vec3::ONE, of_point.normal(), Some(Arc::new(of_point)))
            }
        };
        Some(Self {
            position: point.position,
            receiver,
            is_first,
            start,
            weight: throughput * weight,
            geometric: encode_direction(point.horizon_normal()),
            shading: encode_direction(surface.shading_normal()),
            normal: encode_direction(normal),
            closures,
        })
    }

    /// Unit normal about which it reflects.
    pub fn normal(&self) -> Vec3 {
        decode_direction(self.normal)
    }

    /// Bound of what it adds to the pixel of light that comes from everywhere, for the choice between vertices.
    pub(super) fn importance(&self) -> f32 {
        let albedo = self.closures.as_ref().map_or(Vec3::ONE, |closures| closures.weight());
        (self.weight * albedo).max_element()
    }

    /// Memory that its closures take, bytes.
    pub(super) fn bytes_of_closures(&self) -> usize {
        self.closures.as_ref().map_or(0, |closures| closures.bytes())
    }

    /// The vertex with so many times its weight.
    pub(super) fn scaled(&self, factor: f32) -> Self {
        Self { weight: self.weight * factor, ..self.clone() }
    }

    /// What light of radiance 1 per steradian from the unit direction `wi` adds to the pixel if nothing is in between, and the
    /// ray that tells whether something is; nothing where none is reflected.
    pub(super) fn reflect(&self, wi: Vec3) -> Option<(Vec3, Ray)> {
        let (geometric, shading) = (decode_direction(self.geometric), decode_direction(self.shading));
        let reflectance = match &self.closures {
            None => Vec3::splat(lambert(shading, self.normal(), wi)),
            Some(closures) => closures.eval(wi),
        };
        let reflected = self.weight * reflectance;
        let reach = SideNormals { geometric, shading }.reach(wi, false)?;
        let is_lit = reflected.max_element() > 0.0 && reflected.is_finite();
        is_lit.then(|| (reflected, self.start.ray(wi, reach)))
    }

    /// The ray of a shadow as shaders see it.
    pub(super) fn ray_info(&self) -> RayInfo {
        self.start.ray_info(self.position)
    }
}
