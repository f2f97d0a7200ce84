//! Subsurface scattering of closure nodes.

use glam::Vec3;
use relume_scene::{Subsurface, SubsurfaceMethod, SubsurfaceModel};

use super::SurfacePoint;
use super::values::NodeInputs;
use crate::bsdf::{Bssrdf, Surface};

/// Largest anisotropy of either sign: beyond, light would go straight on.
const MOST_ANISOTROPY: f32 = 0.99;

/// Values of a node's [`Subsurface`].
#[derive(Clone, Debug)]
pub struct BodyParameters {
    radius: Vec3,
    /// Index of refraction as the socket says.
    pub ior: f32,
    /// Anisotropy as the socket says.
    pub anisotropy: f32,
    model: SubsurfaceModel,
}

/// Surface that light enters a body through.
pub struct Boundary {
    /// Unit normal.
    pub normal: Vec3,
    /// Width of the facets.
    pub alpha: f32,
    /// Index of refraction.
    pub ior: f32,
}

impl BodyParameters {
    pub fn read(subsurface: &Subsurface, inputs: &impl NodeInputs) -> Self {
        let Subsurface { radius, scale, ior, anisotropy, model } = subsurface;
        Self {
            radius: (inputs.vector(radius) * inputs.float(scale)).max(Vec3::ZERO),
            ior: inputs.float(ior),
            anisotropy: inputs.float(anisotropy),
            model: *model,
        }
    }

    /// Index of refraction within a node that has one, `outer`, beside that of the socket, which is for skin.
    pub fn own_ior(&self, outer: f32) -> f32 {
        if self.model.method == SubsurfaceMethod::Skin { self.ior } else { outer }
    }
}

/// Adds a body of `albedo`, which `weight` holds too.
pub fn add(
    body: &BodyParameters,
    weight: Vec3,
    albedo: Vec3,
    boundary: &Boundary,
    point: &SurfacePoint,
    surface: &mut Surface,
) {
    let model = &body.model;
    let [least, most] = model.anisotropy_limits;
    let is_skin = model.method == SubsurfaceMethod::Skin;
    let bssrdf = Bssrdf {
        method: model.method,
        inversion: model.inversion,
        albedo: albedo.max(Vec3::ZERO),
        radius: body.radius,
        anisotropy: body.anisotropy.min(most).max(least).clamp(-MOST_ANISOTROPY, MOST_ANISOTROPY),
        ior: boundary.ior.clamp(1.01, 3.8),
        alpha: if is_skin { 1.0 } else { boundary.alpha },
    };
    let least_radius = model.least_footprint * point.footprint;
    surface.add_body(weight, boundary.normal, bssrdf, least_radius, model);
}

#[cfg(test)]
mod tests {
    use relume_scene::{AlbedoInversion, Input, Node};

    use super::super::tests::{look_down, principled, scene_of};
    use super::*;

    #[test]
    fn a_sheet_sends_through_what_its_anisotropy_says() {
        const STEPS: usize = 40;
        for (towards, expected) in [(-1.0, 0.0), (0.0, 0.5), (0.6, 0.8), (1.0, 1.0)] {
            for roughness in [0.0, 1.0] {
                let mut sheet = principled();
                let Node::Principled {
                    subsurface_weight,
                    subsurface,
                    thin_wall,
                    diffuse_roughness,
                    ior: outer,
                    ..
                } = &mut sheet
                else {
                    unreachable!()
                };
                (*subsurface_weight, *thin_wall) = (Input::Float(1.0), Some(Input::Float(1.0)));
                // Nothing is reflected at the surface itself.
                (*diffuse_roughness, *outer) = (Input::Float(roughness), Input::Float(1.0));
                let model = SubsurfaceModel {
                    method: SubsurfaceMethod::Walk,
                    inversion: AlbedoInversion::VanDeHulst,
                    radius_factor: 1.0,
                    anisotropy_limits: [-0.99, 0.99],
                    least_footprint: 0.0,
                    is_first_only: false,
                };
                let [radius, scale, ior, anisotropy] = [1.0, 1.0, 1.4, towards].map(Input::Float);
                *subsurface = Some(Subsurface { radius, scale, ior, anisotropy, model });
                let surface = look_down(&scene_of(vec![sheet]));
                let mut through = [0.0; 2];
                for i in 0..STEPS * STEPS {
                    let u = [i % STEPS, i / STEPS].map(|i| (i as f32 + 0.5) / STEPS as f32);
                    for (side, sum) in [-1.0, 1.0].into_iter().zip(&mut through) {
                        let (sin, cos) = (std::f32::consts::TAU * u[1]).sin_cos();
                        let r = u[0].sqrt();
                        let wi = Vec3::new(r * cos, r * sin, side * (1.0 - u[0]).sqrt());
                        *sum += surface.eval(wi).0.x / wi.z.abs();
                    }
                }
                let share = through[0] / (through[0] + through[1]);
                assert!((share - expected).abs() < 0.01, "{towards}, roughness {roughness}: {share}");
            }
        }
    }
}
