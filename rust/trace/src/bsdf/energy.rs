//! Albedo tables of single-scattering GGX: what multiple scattering adds, and how much a layer keeps from those
//! below it.
//!
//! Each table has the shape and the parametrisation of Cycles' precomputed ones, so that interpolation between its
//! entries gives what Cycles gives; the entries are integrated here, when first used.

use std::sync::LazyLock;

use glam::Vec3;
use rayon::prelude::*;

use super::distribution::{MicrofacetDistribution, SlopeDistribution};
use super::fresnel;

/// Albedo of white single-scattering reflection: roughness x cosine.
static REFLECTION: LazyLock<EnergyTable<2>> =
    LazyLock::new(|| EnergyTable::new([32, 32], |[rough, mu]| reflection_albedo(rough, mu, 1024)));
/// [`REFLECTION`] averaged over all directions: roughness.
static REFLECTION_MEAN: LazyLock<EnergyTable<1>> = LazyLock::new(|| {
    EnergyTable::new([32], |[rough]| mean_over_cosines(|mu| reflection_albedo(rough, mu, 64)))
});
/// Albedo of white glass entered from outside: roughness x cosine x index.
static GLASS: LazyLock<EnergyTable<3>> = LazyLock::new(|| glass_table(|ior| ior));
/// Albedo of white glass met from inside: roughness x cosine x index.
static GLASS_INSIDE: LazyLock<EnergyTable<3>> = LazyLock::new(|| glass_table(|ior| 1.0 / ior));
/// [`GLASS`] averaged over all directions: roughness x index.
static GLASS_MEAN: LazyLock<EnergyTable<2>> = LazyLock::new(|| glass_mean_table(|ior| ior));
/// [`GLASS_INSIDE`] averaged over all directions: roughness x index.
static GLASS_INSIDE_MEAN: LazyLock<EnergyTable<2>> = LazyLock::new(|| glass_mean_table(|ior| 1.0 / ior));
/// Place of the reflectance of a rough dielectric between its values at 0 and 90 degrees: roughness x cosine x index.
static DIELECTRIC_RISE: LazyLock<EnergyTable<3>> = LazyLock::new(|| {
    EnergyTable::new([16, 16, 16], |[rough, mu, z]| {
        let ior = ior_at(z);
        let f0 = fresnel::f0_from_ior(ior);
        mean_rise(rough, mu, |cos| ((fresnel::dielectric(cos, ior).0 - f0) / (1.0 - f0)).clamp(0.0, 1.0))
    })
});
/// Compensation table for Schlick's curve: roughness x cosine.
static SCHLICK_RISE: LazyLock<EnergyTable<2>> = LazyLock::new(|| {
    EnergyTable::new([16, 16], |[rough, mu]| mean_rise(rough, mu, |cos| (1.0 - cos).powi(5)))
});

/// Compensation for the energy that single scattering loses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation {
    /// Factor on the single-scattering closure that makes its albedo 1 if nothing is absorbed.
    pub scale: f32,
    /// Factor on the closure's weight for what is absorbed in each further bounce.
    pub darkening: Vec3,
}

impl Compensation {
    /// Compensation for reflection of mean reflectance `f_mean`, seen at cosine `mu`.
    pub fn reflection(roughness: f32, mu: f32, f_mean: Vec3) -> Self {
        Self::new(REFLECTION.at([roughness, mu]), REFLECTION_MEAN.at([roughness]), f_mean)
    }

    /// Compensation for glass of relative index `ior` and transmissive tint `f_mean`.
    pub fn glass(roughness: f32, mu: f32, ior: f32, f_mean: Vec3) -> Self {
        let z = ior_coordinate(ior);
        let (table, mean) =
            if ior < 1.0 { (&*GLASS_INSIDE, &*GLASS_INSIDE_MEAN) } else { (&*GLASS, &*GLASS_MEAN) };
        Self::new(table.at([roughness, mu, z]), mean.at([roughness, z]), f_mean)
    }

    /// Turquin, "Practical Multiple Scattering Compensation for Microfacet Models" (2019) for the scale; Kulla and
    /// Conty (2017), appendix, for the colour of the added bounces.
    fn new(albedo: f32, mean_albedo: f32, f_mean: Vec3) -> Self {
        let albedo = albedo.max(1e-4);
        let missing = (1.0 - albedo) / albedo;
        let scale = 1.0 + missing;
        let added = f_mean * mean_albedo / (1.0 - f_mean * (1.0 - mean_albedo));
        Self { scale, darkening: (1.0 + added * missing) / scale }
    }
}

/// Share of light that single scattering of white glass keeps, of relative index `ior`, seen at cosine `mu`.
pub fn single_scattering_of_glass(roughness: f32, mu: f32, ior: f32) -> f32 {
    let table = if ior < 1.0 { &*GLASS_INSIDE } else { &*GLASS };
    table.at([roughness, mu, ior_coordinate(ior)])
}

/// Position between the reflectances at 0 and 90 degrees of the mean reflectance of a rough dielectric.
pub fn dielectric_rise(roughness: f32, mu: f32, ior: f32) -> f32 {
    DIELECTRIC_RISE.at([roughness, mu, ior_coordinate(ior)])
}

/// Compensation for Schlick's curve; see [`dielectric_rise`] for dielectrics.
pub fn schlick_rise(roughness: f32, mu: f32) -> f32 {
    SCHLICK_RISE.at([roughness, mu])
}

/// The tables' third axis: fourth root of the reflectance at normal incidence.
fn ior_coordinate(ior: f32) -> f32 {
    ((ior - 1.0) / (ior + 1.0)).abs().sqrt()
}

/// Inverse of [`ior_coordinate`] for indices above 1.
fn ior_at(z: f32) -> f32 {
    fresnel::ior_from_f0(z.clamp(1e-4, 0.99).powi(4))
}

/// A function of `D` numbers in 0..1, linear between evenly spaced samples; the first axis varies fastest.
#[derive(Debug)]
struct EnergyTable<const D: usize> {
    size: [usize; D],
    values: Vec<f32>,
}

impl<const D: usize> EnergyTable<D> {
    fn new(size: [usize; D], f: impl Fn([f32; D]) -> f32 + Sync) -> Self {
        let values = (0..size.iter().product::<usize>())
            .into_par_iter()
            .map(|mut index| {
                f(size.map(|count| {
                    let i = index % count;
                    index /= count;
                    (i as f32 / (count - 1) as f32).max(1e-4)
                }))
                .clamp(0.0, 1.0)
            })
            .collect();
        Self { size, values }
    }

    fn at(&self, x: [f32; D]) -> f32 {
        let mut base = 0;
        let mut stride = 1;
        let mut strides = [0; D];
        let mut fractions = [0.0; D];
        for axis in 0..D {
            let last = self.size[axis] - 1;
            let position = x[axis].clamp(0.0, 1.0) * last as f32;
            let cell = (position as usize).min(last - 1);
            fractions[axis] = position - cell as f32;
            strides[axis] = stride;
            base += cell * stride;
            stride *= self.size[axis];
        }
        let mut sum = 0.0;
        for corner in 0..1usize << D {
            let mut weight = 1.0;
            let mut index = base;
            for axis in 0..D {
                if corner >> axis & 1 == 1 {
                    weight *= fractions[axis];
                    index += strides[axis];
                } else {
                    weight *= 1.0 - fractions[axis];
                }
            }
            sum += weight * self.values[index];
        }
        sum
    }
}

/// Means of `f` over the visible normals of an isotropic GGX surface; `f` gets the surface, the direction of view
/// and the normal.
fn mean_over_normals(
    rough: f32,
    mu: f32,
    samples: u32,
    f: impl Fn(&MicrofacetDistribution, Vec3, Vec3) -> f32,
) -> f32 {
    let alpha = rough * rough;
    let surface = MicrofacetDistribution { shape: SlopeDistribution::Ggx, alpha_x: alpha, alpha_y: alpha };
    let wo = Vec3::new((1.0 - mu * mu).max(0.0).sqrt(), 0.0, mu);
    let sum: f32 = (0..samples)
        .map(|i| {
            // Hammersley's points.
            let u = [(i as f32 + 0.5) / samples as f32, i.reverse_bits() as f32 / 4_294_967_296.0];
            f(&surface, wo, surface.sample_visible(wo, [u[1], u[0]]))
        })
        .sum();
    sum / samples as f32
}

/// Part of the light from `wo` that leaves the surface towards `wi` unshadowed, given that it met a facet there.
fn unshadowed(surface: &MicrofacetDistribution, wo: Vec3, wi: Vec3) -> f32 {
    let seen = 1.0 + surface.lambda(wo);
    seen / (seen + surface.lambda(wi))
}

fn reflection_albedo(rough: f32, mu: f32, samples: u32) -> f32 {
    mean_over_normals(rough, mu, samples, |surface, wo, h| {
        let wi = h * (2.0 * h.dot(wo)) - wo;
        if wi.z > 0.0 { unshadowed(surface, wo, wi) } else { 0.0 }
    })
}

fn glass_albedo(rough: f32, mu: f32, ior: f32, samples: u32) -> f32 {
    // What goes straight on loses nothing, however rough the surface.
    if fresnel::is_unbending(ior) {
        return 1.0;
    }
    mean_over_normals(rough, mu, samples, |surface, wo, h| {
        let cos = h.dot(wo);
        let (reflectance, cos_t) = fresnel::dielectric(cos, ior);
        let reflected = h * (2.0 * cos) - wo;
        let refracted = h * (cos / ior - cos_t) - wo / ior;
        let mut albedo = 0.0;
        if reflected.z > 0.0 {
            albedo += reflectance * unshadowed(surface, wo, reflected);
        }
        if reflectance < 1.0 && refracted.z < 0.0 {
            albedo += (1.0 - reflectance) * unshadowed(surface, wo, refracted);
        }
        albedo
    })
}

fn mean_rise(rough: f32, mu: f32, rise: impl Fn(f32) -> f32) -> f32 {
    mean_over_normals(rough, mu, 256, |_, wo, h| {
        let cos = h.dot(wo);
        if (h * (2.0 * cos) - wo).z > 0.0 { rise(cos) } else { 0.0 }
    })
}

fn mean_over_cosines(f: impl Fn(f32) -> f32) -> f32 {
    const STEPS: usize = 64;
    (0..STEPS).map(|i| (i as f32 + 0.5) / STEPS as f32).map(|mu| 2.0 * mu * f(mu)).sum::<f32>() / STEPS as f32
}

fn glass_table(relative: impl Fn(f32) -> f32 + Sync) -> EnergyTable<3> {
    EnergyTable::new([16, 16, 16], |[rough, mu, z]| glass_albedo(rough, mu, relative(ior_at(z)), 256))
}

fn glass_mean_table(relative: impl Fn(f32) -> f32 + Sync) -> EnergyTable<2> {
    EnergyTable::new([16, 16], |[rough, z]| {
        mean_over_cosines(|mu| glass_albedo(rough, mu, relative(ior_at(z)), 32))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_interpolate_linear_functions_exactly() {
        let table = EnergyTable::new([5, 4, 3], |[x, y, z]| 0.1 + 0.2 * x + 0.3 * y + 0.4 * z);
        for [x, y, z] in [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.3, 0.77, 0.5], [0.01, 0.99, 0.2]] {
            let expected = 0.1 + 0.2 * x + 0.3 * y + 0.4 * z;
            assert!((table.at([x, y, z]) - expected).abs() < 1e-4);
        }
    }

    #[test]
    fn smooth_surfaces_lose_nothing_and_rough_ones_do() {
        assert!((REFLECTION.at([0.0, 0.5]) - 1.0).abs() < 1e-3);
        // At roughness 1 and normal incidence the integral is 1 - ln 2.
        let rough = REFLECTION.at([1.0, 1.0]);
        assert!((rough - (1.0 - std::f32::consts::LN_2)).abs() < 1e-3, "{rough}");
        assert!(GLASS.at([0.0, 0.5, 0.4]) > 0.999);
        assert!(GLASS.at([1.0, 0.5, 0.4]) < 0.98);
        assert_eq!(Compensation::glass(1.0, 0.5, 1.0, Vec3::ONE).scale, 1.0);
    }

    #[test]
    fn white_needs_no_darkening() {
        let compensation = Compensation::reflection(0.8, 0.6, Vec3::ONE);
        assert!((compensation.darkening - Vec3::ONE).length() < 1e-5);
        assert!(compensation.scale > 1.0);
    }
}
