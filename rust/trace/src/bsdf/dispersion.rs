//! Wavelengths of paths, and glass that bends light by them.

use glam::Vec3;
use relume_scene::Dispersion;

/// Fraunhofer's lines d, F and C, nm.
const D_NM: f32 = 587.6;
const F_NM: f32 = 486.1;
const C_NM: f32 = 656.3;
/// Middle and scale of the logistic distribution that wavelengths are drawn from, nm: near the luminance of daylight.
const MIDDLE_NM: f32 = 555.5;
const SCALE_NM: f32 = 46.0;

/// Share of the logistic distribution below a wavelength.
fn share_below(nm: f32) -> f32 {
    1.0 / (1.0 + ((MIDDLE_NM - nm) / SCALE_NM).exp())
}

/// Wavelength in nm for a number in 0..1.
pub(crate) fn sample_wavelength(u: f32) -> f32 {
    let [first, last] = Dispersion::RANGE_NM;
    let [low, high] = [first, last].map(share_below);
    let share = low + (high - low) * u;
    (MIDDLE_NM - SCALE_NM * (1.0 / share - 1.0).ln()).clamp(first, last)
}

/// Density of [`sample_wavelength`], per range of wavelengths.
fn density(nm: f32) -> f32 {
    let [first, last] = Dispersion::RANGE_NM;
    let [low, high] = [first, last].map(share_below);
    let share = share_below(nm);
    share * (1.0 - share) / (SCALE_NM * (high - low)) * (last - first)
}

/// Scene-linear weight of a path of a wavelength drawn by [`sample_wavelength`]; on average white.
pub(crate) fn wavelength_weight(dispersion: &Dispersion, nm: f32) -> Vec3 {
    let [first, last] = Dispersion::RANGE_NM;
    let step = (nm - first) / (last - first) * dispersion.colors.len() as f32;
    let color = dispersion.colors.get((step as usize).min(dispersion.colors.len() - 1));
    color.map_or(Vec3::ZERO, |color| Vec3::from(*color) / density(nm))
}

/// Index of refraction at a wavelength of glass whose index is `ior` at the line d, by Cauchy's formula (OpenPBR Surface 1.1,
/// equations 55 and 56); `inverse_abbe` is the reciprocal of its Abbe number.
pub(crate) fn dispersed_ior(ior: f32, inverse_abbe: f32, nm: f32) -> f32 {
    let inverse_square = |nm: f32| 1e6 / (nm * nm);
    let rise = (ior - 1.0) * inverse_abbe / (inverse_square(F_NM) - inverse_square(C_NM));
    (ior + rise * (inverse_square(nm) - inverse_square(D_NM))).max(1e-5)
}

#[cfg(test)]
mod tests {
    use relume_scene::Input;

    use super::*;

    fn flat() -> Dispersion {
        let input = Input::Float(1.0);
        Dispersion { scale: input, abbe_number: input, colors: vec![[1.0; 3]; 7] }
    }

    #[test]
    fn weights_of_wavelengths_are_white_on_average() {
        let count = 100_000;
        let weight = |i: u32| wavelength_weight(&flat(), sample_wavelength((i as f32 + 0.5) / count as f32));
        let mean = (0..count).map(|i| weight(i).as_dvec3()).sum::<glam::DVec3>() / f64::from(count);
        assert!((mean - 1.0).abs().max_element() < 1e-3, "{mean}");
    }

    #[test]
    fn abbe_numbers_are_those_of_the_dispersed_indices() {
        let at = |nm| dispersed_ior(1.6, 1.0 / 30.0, nm);
        assert!((at(D_NM) - 1.6).abs() < 1e-6);
        assert!(((at(D_NM) - 1.0) / (at(F_NM) - at(C_NM)) - 30.0).abs() < 0.01);
        assert!(at(400.0) > at(700.0));
    }
}
