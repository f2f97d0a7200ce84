//! Microfacet distributions: density of normals, masking, and sampling of visible normals, in the frame whose z
//! is the macroscopic normal.
//!
//! Walter et al., "Microfacet Models for Refraction through Rough Surfaces" (EGSR 2007); Heitz, "Understanding the
//! Masking-Shadowing Function in Microfacet-Based BRDFs" (JCGT 2014), equation numbers are its.

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::Vec3;

use super::frame::sample_disk;

/// Shape of the distribution of slopes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlopeDistribution {
    /// Trowbridge-Reitz.
    Ggx,
    /// Gaussian slopes.
    Beckmann,
}

/// A distribution of microfacet normals.
#[derive(Clone, Copy, Debug)]
pub struct MicrofacetDistribution {
    /// Shape of the distribution.
    pub shape: SlopeDistribution,
    /// Width along x, 0..1.
    pub alpha_x: f32,
    /// Width along y, 0..1.
    pub alpha_y: f32,
}

impl MicrofacetDistribution {
    /// Products of widths up to this are taken for a perfect mirror (Cycles' `BSDF_ROUGHNESS_SQ_THRESH`).
    const SINGULAR_ALPHA_SQUARED: f32 = 5e-7;

    /// True if the surface is so smooth that it is a mirror.
    pub fn is_singular(&self) -> bool {
        self.alpha_x * self.alpha_y <= Self::SINGULAR_ALPHA_SQUARED
    }

    /// Density of normals over solid angle, projected on the macrosurface it integrates to 1.
    pub fn density(&self, h: Vec3) -> f32 {
        let stretched = Vec3::new(h.x / self.alpha_x, h.y / self.alpha_y, h.z);
        let alpha_squared = self.alpha_x * self.alpha_y;
        match self.shape {
            SlopeDistribution::Ggx => FRAC_1_PI / (alpha_squared * stretched.length_squared().powi(2)),
            SlopeDistribution::Beckmann => {
                let cos_squared = h.z * h.z;
                let tan_squared = (stretched.x * stretched.x + stretched.y * stretched.y) / cos_squared;
                (-tan_squared).exp() / (PI * alpha_squared * cos_squared * cos_squared)
            }
        }
    }

    /// Smith's auxiliary function, equations 72 and 66.
    pub fn lambda(&self, v: Vec3) -> f32 {
        let x = self.alpha_x * v.x;
        let y = self.alpha_y * v.y;
        let tan_squared = (x * x + y * y) / (v.z * v.z);
        match self.shape {
            SlopeDistribution::Ggx => 0.5 * ((1.0 + tan_squared).sqrt() - 1.0),
            // Below, a > 4 and the function is less than 1e-8.
            SlopeDistribution::Beckmann if tan_squared < 0.0625 => 0.0,
            SlopeDistribution::Beckmann => {
                let a = 1.0 / tan_squared.sqrt();
                0.5 * (erf(a) - 1.0 + (-a * a).exp() / (a * PI.sqrt()))
            }
        }
    }

    /// A normal out of those visible from `wo`, with density `density(h) max(wo.h, 0) / (wo.z (1 + lambda(wo)))`.
    pub fn sample_visible(&self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(self.alpha_x * wo.x, self.alpha_y * wo.y, wo.z).normalize_or(Vec3::Z);
        let h = match self.shape {
            SlopeDistribution::Ggx => sample_ggx_hemisphere(stretched, u),
            SlopeDistribution::Beckmann => sample_beckmann_slopes(stretched, u),
        };
        Vec3::new(self.alpha_x * h.x, self.alpha_y * h.y, h.z.max(0.0)).normalize_or(Vec3::Z)
    }
}

/// Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps" (HPG 2023): a uniform direction of the
/// cap of half vectors' reflections, then its half vector with the stretched `wo`.
fn sample_ggx_hemisphere(wo: Vec3, u: [f32; 2]) -> Vec3 {
    let (sin_phi, cos_phi) = (TAU * u[0]).sin_cos();
    let z = (1.0 - u[1]) * (1.0 + wo.z) - wo.z;
    let sin = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(sin * cos_phi, sin * sin_phi, z) + wo
}

/// Visible slopes of a Beckmann surface of width 1, seen from `wo`: inversion of the distribution by Newton's
/// method with bisection (Heitz and d'Eon, EGSR 2014; Jakob, "An Improved Visible Normal Sampling Routine for the
/// Beckmann Distribution", 2014).
fn sample_beckmann_slopes(wo: Vec3, u: [f32; 2]) -> Vec3 {
    if wo.z > 0.9999 {
        let radius = (-(1.0 - u[0]).max(f32::MIN_POSITIVE).ln()).sqrt();
        let (x, y) = sample_disk([1.0, u[1]]);
        return Vec3::new(-radius * x, -radius * y, 1.0);
    }
    let sin = (1.0 - wo.z * wo.z).max(0.0).sqrt();
    let tan = sin / wo.z.max(1e-6);
    let cot = 1.0 / tan;
    let erf_cot = erf(cot);
    // Cumulative distribution of visible slopes over b = erf(slope), up to its norm: 1 + b + k exp(-slope^2).
    let k = tan / PI.sqrt();
    let target = u[0].max(1e-6) * (1.0 + erf_cot + k * (-cot * cot).exp());
    let (mut low, mut high) = (-1.0f32, erf_cot);
    // Start from exp(-erf_inv(b)^2) ~ 1 - b^2, which makes the equation quadratic.
    let approximate = u[0] * (1.0 + erf_cot + k * (1.0 - erf_cot * erf_cot));
    let mut b = (0.5 - (k * (k - approximate + 1.0) + 0.25).max(0.0).sqrt()) / k;
    let mut slope_x = 0.0;
    for _ in 0..10 {
        if !(b >= low && b <= high) {
            b = 0.5 * (low + high);
        }
        slope_x = erf_inv(b);
        let value = 1.0 + b + k * (-slope_x * slope_x).exp() - target;
        if value.abs() < 1e-5 {
            break;
        }
        if value > 0.0 {
            high = b;
        } else {
            low = b;
        }
        b -= value / (1.0 - slope_x * tan);
    }
    let slope_y = erf_inv(2.0 * u[1].clamp(1e-6, 1.0 - 1e-6) - 1.0);
    let (cos_phi, sin_phi) = (wo.x / sin, wo.y / sin);
    Vec3::new(-(cos_phi * slope_x - sin_phi * slope_y), -(sin_phi * slope_x + cos_phi * slope_y), 1.0)
}

/// Error function, absolute error below 1.5e-7: Abramowitz and Stegun 7.1.26.
fn erf(x: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let polynomial =
        t * (0.254_829_6 + t * (-0.284_496_74 + t * (1.421_413_7 + t * (-1.453_152 + t * 1.061_405_4))));
    (1.0 - polynomial * (-x * x).exp()).copysign(x)
}

/// Inverse error function, relative error below 4e-7: Giles, "Approximating the erfinv Function" (2010).
fn erf_inv(x: f32) -> f32 {
    let x = x.clamp(-0.999_999_94, 0.999_999_94);
    let w = -((1.0 - x) * (1.0 + x)).ln();
    let coefficients: [f32; 9] = if w < 5.0 {
        [
            2.810_226_4e-8,
            3.432_739_4e-7,
            -3.523_387_7e-6,
            -4.391_506_5e-6,
            2.185_808_7e-4,
            -1.253_725_1e-3,
            -4.177_681_6e-3,
            2.466_407_3e-1,
            1.501_409_4,
        ]
    } else {
        [
            -2.002_142_6e-4,
            1.009_505_6e-4,
            1.349_343_2e-3,
            -3.673_428_4e-3,
            5.739_507_7e-3,
            -7.622_461e-3,
            9.438_87e-3,
            1.001_674,
            2.832_976_8,
        ]
    };
    let t = if w < 5.0 { w - 2.5 } else { w.sqrt() - 3.0 };
    x * coefficients.iter().fold(0.0, |sum, c| sum * t + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_and_its_inverse_agree() {
        for i in -30..=30 {
            let x = i as f32 * 0.1;
            assert!((erf_inv(erf(x)) - x).abs() < 2e-2 * x.abs().powi(2).max(0.01), "{x}");
        }
        assert!((erf(1.0) - 0.842_700_8).abs() < 1e-6);
        assert!((erf_inv(0.5) - 0.476_936_28).abs() < 1e-6);
    }

    #[test]
    fn projected_density_integrates_to_one() {
        for shape in [SlopeDistribution::Ggx, SlopeDistribution::Beckmann] {
            let distribution = MicrofacetDistribution { shape, alpha_x: 0.5, alpha_y: 0.3 };
            let (rows, columns) = (4000, 200);
            let mut sum = 0.0f64;
            for row in 0..rows {
                let z = (row as f32 + 0.5) / rows as f32;
                let sin = (1.0 - z * z).sqrt();
                for column in 0..columns {
                    let (y, x) = (TAU * (column as f32 + 0.5) / columns as f32).sin_cos();
                    sum += f64::from(distribution.density(Vec3::new(sin * x, sin * y, z)) * z);
                }
            }
            let integral = sum * std::f64::consts::TAU / f64::from(rows * columns);
            assert!((integral - 1.0).abs() < 1e-3, "{shape:?}: {integral}");
        }
    }
}
