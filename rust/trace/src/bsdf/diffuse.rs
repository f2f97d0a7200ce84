//! Diffuse reflection: Oren and Nayar's model in Fujii's form (mimosa-pudica.net/improved-oren-nayar.html) with the
//! energy that is scattered more than once, as OpenPBR 1.1 specifies it. Roughness 0 is Lambert's.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI, TAU};

use glam::Vec3;
use relume_scene::MultipleScattering;

use super::{Scatter, Surface, frame::sample_cosine};

/// A rough diffuse surface.
#[derive(Clone, Copy, Debug)]
pub struct OrenNayar {
    normal: Vec3,
    a: f32,
    b: f32,
    /// Multiply scattered part without the factor that depends on the light's direction.
    multiple: Vec3,
}

impl OrenNayar {
    /// A surface of perceptual `roughness` 0..1 and the given albedo `color`, seen from `wo`. The closure's weight is
    /// to hold `color` once.
    pub fn new(normal: Vec3, roughness: f32, color: Vec3, multiple: MultipleScattering, wo: Vec3) -> Self {
        let sigma = roughness.clamp(0.0, 1.0);
        let a = 1.0 / (PI + sigma * (FRAC_PI_2 - 2.0 / 3.0));
        let b = sigma * a;
        let color = color.clamp(Vec3::ZERO, Vec3::ONE);
        let mean = a * PI + (TAU - 5.6) / 3.0 * b;
        let surface = Self { normal, a, b, multiple: Vec3::ZERO };
        let missing = 1.0 - surface.single_albedo(normal.dot(wo).max(0.0));
        let dimmed = match multiple {
            MultipleScattering::Full => color,
            MultipleScattering::Dimmed => color * color,
        };
        let multiple = FRAC_1_PI * dimmed * (mean / (1.0 - mean)) / (1.0 - color * (1.0 - mean)) * missing;
        Self { multiple, ..surface }
    }

    /// `f |cos|` for a white surface.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        let cos_i = self.normal.dot(wi);
        if cos_i <= 0.0 {
            return Vec3::ZERO;
        }
        let cos_o = self.normal.dot(wo).max(0.0);
        let mut s = wi.dot(wo) - cos_i * cos_o;
        if s > 0.0 {
            s /= cos_i.max(cos_o) + f32::MIN_POSITIVE;
        }
        let missing = 1.0 - self.single_albedo(cos_i);
        (Vec3::splat(self.a + self.b * s) + self.multiple * missing) * cos_i
    }

    /// Albedo of single scattering at `cos` to the normal.
    fn single_albedo(&self, cos: f32) -> f32 {
        let g = if cos < 1e-6 {
            FRAC_PI_2 - 2.0 / 3.0 - cos
        } else {
            let cos = cos.min(1.0);
            let sin = (1.0 - cos * cos).max(0.0).sqrt();
            sin * (cos.acos() - 2.0 / 3.0 - sin * cos) + 2.0 / 3.0 * (sin / cos) * (1.0 - sin * sin * sin)
        };
        self.a * PI + self.b * g
    }
}

impl Surface {
    /// White light that the diffuse closures scatter from one of the directions around their mean normal
    /// (`surface_shader_ao`), and that direction; nothing where there are none.
    pub(crate) fn scatter_open_light(&self, u: [f32; 2]) -> Option<(Vec3, Vec3)> {
        let (mut weight, mut normal) = (Vec3::ZERO, Vec3::ZERO);
        for closure in &self.closures {
            let is_diffuse = match &closure.scatter {
                Scatter::Diffuse
                | Scatter::OrenNayar(_)
                | Scatter::Translucent
                | Scatter::RoughTranslucent(_)
                | Scatter::Sheen(_) => true,
                Scatter::Toon(model) => !model.is_glossy,
                _ => false,
            };
            if is_diffuse {
                weight += closure.weight;
                normal += closure.normal * (closure.weight.element_sum() / 3.0);
            }
        }
        // Cycles weighs what is see-through twice.
        let alpha = (Vec3::ONE - self.transparency()).clamp(Vec3::ZERO, Vec3::ONE);
        let direction = sample_cosine(normal.normalize_or(self.shading_normal()), u);
        (weight != Vec3::ZERO).then_some((weight * alpha, direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEPS: usize = 24;

    /// Albedo under light from all sides, seen from all sides, by quadrature.
    fn mean_albedo(color: f32, multiple: MultipleScattering) -> f32 {
        let directions = |count: usize| {
            // A cosine's density, so that each direction counts alike.
            (0..STEPS * count).map(move |i| {
                let u = [i % STEPS, i / STEPS];
                let height = (u[0] as f32 + 0.5) / STEPS as f32;
                let (sin, cos) = (TAU * (u[1] as f32 + 0.5) / count as f32).sin_cos();
                let r = height.sqrt();
                Vec3::new(r * cos, r * sin, (1.0 - height).sqrt())
            })
        };
        let mut sum = 0.0;
        for wo in directions(1) {
            let surface = OrenNayar::new(Vec3::Z, 0.9, Vec3::splat(color), multiple, wo);
            sum += directions(STEPS).map(|wi| surface.eval(wo, wi).x / wi.z * PI).sum::<f32>();
        }
        color * sum / (STEPS * STEPS * STEPS) as f32
    }

    #[test]
    fn what_is_scattered_again_is_dimmed_each_time() {
        // What each bounce lets out of the surface: the single scattering of one that is nearly black.
        let out = mean_albedo(1e-4, MultipleScattering::Full) / 1e-4;
        assert!(0.6 < out && out < 0.9, "{out}");
        for color in [0.2, 0.5, 0.8, 1.0f32] {
            // The sum over bounces of color * out * (color * (1 - out))^n.
            let series = color * out / (1.0 - color * (1.0 - out));
            let full = mean_albedo(color, MultipleScattering::Full);
            assert!((full - series).abs() < 2e-3, "{full} {series}");
            let dimmed = mean_albedo(color, MultipleScattering::Dimmed);
            let once = color * out;
            assert!((dimmed - (once + color * (series - once))).abs() < 2e-3, "{dimmed}");
        }
    }
}
