//! Random walks, as often guided to the surface as in Cycles: paths end after so many steps that what a guide leaves out
//! would show.
//!
//! Directions of a guided step follow Dwivedi's distribution about the normal of the entry, and its distances those of a
//! medium stretched along it (Krivanek and d'Eon, "A Zero-Variance-Based Sampling Scheme for Monte Carlo Subsurface
//! Scattering", SIGGRAPH 2014; Meng, Hanika and Dachsbacher, "Improving the Dwivedi Sampling Scheme", EGSR 2016). The
//! balance heuristic joins them with plain steps, and the channels with each other.

use glam::Vec3;

use super::{BodyExit, medium::Medium};
use crate::{bsdf::ShadingFrame, bvh::Ray, media::Phase, shading::Hit};

/// Most steps of a walk; a path that is still inside then ends.
const MOST_STEPS: u32 = 256;
/// Steps with the medium's own anisotropy. Later ones scatter isotropically in a medium that looks alike from afar
/// (similarity: `sigma_s (1 - g)` stays).
const ANISOTROPIC_STEPS: u32 = 10;
/// Share of the later steps that are guided.
const LATER_GUIDED: f32 = 0.75;
/// Throughput below which a path ends inside.
const LEAST_THROUGHPUT: f32 = 1e-6;
/// Mean free paths within which another side of the body is looked for.
const THIN: f32 = 10.0;

/// Walks from `ray`, which has entered at a surface of this normal, until `find` meets the surface again.
pub(super) fn walk(
    medium: &Medium,
    mut ray: Ray,
    normal: Vec3,
    mut throughput: Vec3,
    find: impl Fn(&Ray) -> Option<Hit>,
    draw: impl Fn(u32) -> [f32; 4],
) -> Option<BodyExit> {
    let (mut scattering, mut extinction) = (medium.scattering, medium.extinction);
    let (anisotropy, mut phase) = (medium.anisotropy, Phase::henyey_greenstein(medium.anisotropy));
    let mut guided = 1.0 - anisotropy.abs().powf(0.125).max(0.5);
    let mut guide = Dwivedi::new(ray.origin, normal, medium.albedo.max_element());
    for step in 0..MOST_STEPS {
        if step == ANISOTROPIC_STEPS {
            extinction -= scattering * anisotropy;
            scattering *= 1.0 - anisotropy;
            (phase, guided) = (Phase::henyey_greenstein(0.0), LATER_GUIDED);
        }
        let u = draw(step);
        let choices = channel_probabilities(throughput * medium.albedo);
        let (channel, rest) = choose(choices, u[0]);
        let mut of_channel = extinction[channel];
        let mut stretched = None;
        if step > 0 {
            let backward = guide.backward_share(ray.origin);
            let before = ray.direction;
            if rest < guided {
                let is_backward = rest < guided * backward;
                ray.direction = guide.direction(is_backward, [u[2], u[3]]);
                of_channel *= guide.stretch(ray.direction, is_backward);
            } else {
                ray.direction = phase.sample(before, [u[2], u[3]]);
            }
            ray.from = None;
            let plain = phase.eval(before.dot(ray.direction));
            stretched = Some([false, true].map(|is_backward| {
                let share = guided * if is_backward { backward } else { 1.0 - backward };
                let density = share * guide.density(ray.direction, is_backward) / plain;
                (guide.stretch(ray.direction, is_backward), density)
            }));
        }
        let wanted = -(1.0 - u[1]).ln() / of_channel;
        ray.t_max = if step == 0 { wanted.max(THIN / extinction.min_element()) } else { wanted };
        let mut hit = find(&ray);
        if step == 0 {
            guide.opposite = hit.map(|hit| -normal.dot(ray.direction) * hit.distance);
            hit = hit.filter(|hit| hit.distance < wanted);
        }
        let distance = hit.map_or(wanted, |hit| hit.distance);
        let arrival = |stretch: f32| {
            let extinction = extinction * stretch;
            let transmittance = (extinction * -distance).exp();
            if hit.is_some() { transmittance } else { extinction * transmittance }
        };
        let plain = arrival(1.0);
        let density = match stretched {
            Some(ways) => {
                let sum: Vec3 =
                    ways.into_iter().filter(|way| way.1 > 0.0).map(|way| arrival(way.0) * way.1).sum();
                plain * (1.0 - guided) + sum
            }
            None => plain,
        };
        let value = if hit.is_some() { plain } else { plain * (scattering / extinction) };
        throughput *= value / choices.dot(density);
        ray.origin += ray.direction * distance;
        if let Some(hit) = hit {
            let is_sound = throughput.is_finite() && throughput.max_element() > 0.0;
            let exit = BodyExit { hit, position: ray.origin, outwards: ray.direction, throughput };
            return is_sound.then_some(exit);
        }
        if throughput.max_element() < LEAST_THROUGHPUT {
            return None;
        }
    }
    None
}

/// Dwivedi's sampling of a half space, and back to front of a slab.
struct Dwivedi {
    start: Vec3,
    normal: Vec3,
    frame: ShadingFrame,
    diffusion_length: f32,
    /// Logarithm that normalises the distribution.
    log: f32,
    /// Distance of the other side below the start, if there is one near.
    opposite: Option<f32>,
}

impl Dwivedi {
    /// Guide of a walk from `start` in a medium of this albedo of single scattering. The length is equation 67 of
    /// d'Eon and Krivanek, "Zero-Variance Theory for Efficient Subsurface Scattering" (SIGGRAPH 2020).
    fn new(start: Vec3, normal: Vec3, albedo: f32) -> Self {
        let power = 2.442_94 - 0.021_581_3 * albedo + 0.578_637 / albedo;
        let diffusion_length = 1.0 / (1.0 - albedo.powf(power)).sqrt();
        let log = ((diffusion_length + 1.0) / (diffusion_length - 1.0)).ln();
        let frame = ShadingFrame::from_normal(normal);
        Self { start, normal, frame, diffusion_length, log, opposite: None }
    }

    /// Share of the guided steps from `position` that are guided to the other side.
    fn backward_share(&self, position: Vec3) -> f32 {
        self.opposite.map_or(0.0, |opposite| {
            let depth = (self.start - position).dot(self.normal).min(opposite).max(0.0);
            1.0 / (1.0 + ((opposite - 2.0 * depth) / self.diffusion_length).exp())
        })
    }

    fn direction(&self, is_backward: bool, u: [f32; 2]) -> Vec3 {
        let length = self.diffusion_length;
        let cos = (length - (length + 1.0) * (-u[0] * self.log).exp()).clamp(-1.0, 1.0);
        self.frame.world(spherical(if is_backward { -cos } else { cos }, u[1]))
    }

    /// Density of [`Self::direction`] over solid angle.
    fn density(&self, direction: Vec3, is_backward: bool) -> f32 {
        FRAC_1_TAU / (self.diffusion_length * self.stretch(direction, is_backward) * self.log)
    }

    /// Factor on extinction along a direction.
    fn stretch(&self, direction: Vec3, is_backward: bool) -> f32 {
        let towards = if is_backward { -self.normal } else { self.normal };
        1.0 - towards.dot(direction) / self.diffusion_length
    }
}

const FRAC_1_TAU: f32 = 0.5 * std::f32::consts::FRAC_1_PI;

/// The channel that `u` falls on, and `u` stretched over it to 0..1.
fn choose(probabilities: Vec3, u: f32) -> (usize, f32) {
    let mut rest = u;
    for (channel, probability) in probabilities.to_array().into_iter().enumerate() {
        if rest < probability {
            return (channel, rest / probability);
        }
        rest -= probability;
    }
    // Rounding left a rest after the last one.
    (probabilities.max_position(), 0.0)
}

/// Probabilities in proportion to `weights`.
fn channel_probabilities(weights: Vec3) -> Vec3 {
    let weights = weights.abs();
    let sum = weights.element_sum();
    if sum > 0.0 { weights / sum } else { Vec3::splat(1.0 / 3.0) }
}

/// Direction at a cosine to z, turned by `u` of a full turn.
fn spherical(cos: f32, u: f32) -> Vec3 {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (std::f32::consts::TAU * u).sin_cos();
    Vec3::new(sin * cos_phi, sin * sin_phi, cos)
}

#[cfg(test)]
mod tests {
    use relume_scene::{AlbedoInversion, SubsurfaceMethod};

    use super::*;
    use crate::{
        bsdf::Bssrdf,
        sampler::{Draws, PixelSampler},
    };

    const WALKS: u32 = 1 << 14;

    fn body(color: f32, anisotropy: f32, inversion: AlbedoInversion) -> Bssrdf {
        Bssrdf {
            method: SubsurfaceMethod::Walk,
            inversion,
            albedo: Vec3::splat(color),
            radius: Vec3::ONE,
            anisotropy,
            ior: 1.4,
            alpha: 1.0,
        }
    }

    /// Planes at these heights, seen from between them.
    fn planes(heights: &[f32]) -> impl Fn(&Ray) -> Option<Hit> {
        move |ray| {
            let distances = heights.iter().map(|height| (height - ray.origin.z) / ray.direction.z);
            let distance = distances.filter(|t| *t > 1e-6 && *t < ray.t_max).reduce(f32::min)?;
            let front = Vec3::Z * ray.direction.z.signum();
            Some(Hit {
                instance: 0,
                primitive: 0,
                barycentrics: [0.0; 2],
                distance,
                time: relume_scene::STILL,
                front,
            })
        }
    }

    /// Mean of what comes out of planes, by the height of the place, for light that comes in at 0 from all sides.
    fn escaped(bssrdf: &Bssrdf, heights: &[f32], counts: impl Fn(f32) -> bool) -> f32 {
        let (medium, throughput) = Medium::new(bssrdf, bssrdf.albedo);
        let mut sum = 0.0;
        for sample in 0..WALKS {
            let draws = Draws::new(PixelSampler::new(1, 2, 3), sample, 0);
            let u = draws.at(1000);
            // The diffuse half of the ways into skin.
            let skin = Bssrdf { method: SubsurfaceMethod::Skin, ..*bssrdf };
            let direction = skin.enter(Vec3::Z, Vec3::Z, [0.5 * u[0], u[1]]).unwrap();
            let exit = walk(
                &medium,
                Ray::new(Vec3::ZERO, direction),
                Vec3::Z,
                throughput,
                planes(heights),
                |step| draws.at(step),
            );
            sum += exit.filter(|exit| counts(exit.position.z)).map_or(0.0, |exit| exit.throughput.x);
        }
        sum / WALKS as f32
    }

    #[test]
    fn a_half_space_has_the_albedo_that_its_inside_was_made_for() {
        for (inversion, g) in [
            (AlbedoInversion::VanDeHulst, 0.0),
            (AlbedoInversion::VanDeHulst, 0.6),
            (AlbedoInversion::Polynomial, 0.0),
            (AlbedoInversion::Polynomial, 0.6),
        ] {
            for color in [0.2, 0.5, 0.8] {
                let found = escaped(&body(color, g, inversion), &[0.0], |_| true);
                println!("{inversion:?}, g {g}: {color} gives {found}");
                assert!((found / color - 1.0).abs() < 0.03, "{inversion:?}, g {g}: {color} gives {found}");
            }
        }
    }

    /// Without absorption, light from all sides gets through as heat by radiation between black plates: Heaslet and
    /// Warming, "Radiative transport and wall temperature slip in an absorbing planar medium" (1965).
    #[test]
    fn slabs_without_absorption_transmit_as_tables_say() {
        for (thickness, expected) in [(0.1, 0.9157), (0.5, 0.7040), (1.0, 0.5532), (3.0, 0.3016)] {
            let white = body(1.0, 0.0, AlbedoInversion::VanDeHulst);
            let heights = [0.0, -thickness];
            let through = escaped(&white, &heights, |height| height < -0.5 * thickness);
            let all = escaped(&white, &heights, |_| true);
            let error = (expected * (1.0 - expected) / WALKS as f32).sqrt();
            assert!((through - expected).abs() < 3.0 * error, "{thickness}: {through}, not {expected}");
            assert!((all - 1.0).abs() < 2e-3, "{thickness}: {all} of 1 came out");
        }
    }

    #[test]
    fn channels_that_take_no_part_stay_black_and_harm_no_other() {
        let color = Vec3::new(0.8, 0.5, 0.0);
        let body = Bssrdf {
            albedo: color,
            radius: Vec3::new(1.0, 0.0, 1.0),
            ..body(0.5, 0.0, AlbedoInversion::Polynomial)
        };
        let (medium, throughput) = Medium::new(&body, color * Vec3::new(1.0, 0.0, 1.0));
        let draws = Draws::new(PixelSampler::new(1, 2, 3), 0, 0);
        for sample in 0..100 {
            let ray = Ray::new(Vec3::ZERO, Vec3::NEG_Z);
            let exit = walk(&medium, ray, Vec3::Z, throughput, planes(&[0.0]), |step| {
                draws.at(1000 * sample + step)
            });
            if let Some(exit) = exit {
                assert!(exit.throughput.x > 0.0 && exit.throughput.y == 0.0 && exit.throughput.z == 0.0);
            }
        }
    }
}
