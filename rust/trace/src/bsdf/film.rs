//! Interference in a thin film: Belcour and Barla, "A Practical Extension to Microfacet Theory for the Modeling of Varying
//! Iridescence" (2017). Reflectances are summed over orders of reflection, each with the Fourier transform of the observer's
//! sensitivity at its optical path difference (OPD).

use std::f32::consts::TAU;
use std::sync::OnceLock;

use glam::{Mat3, Vec3};
use relume_scene::FilmModel;

use super::fresnel::{Conductor, F82, dielectric, f0_from_ior};
use super::observer::{FIRST_NM, MATCHING, STEP_NM};

/// Thickness up to which there is no film, nm.
const THINNEST: f32 = 0.1;
/// Highest order of reflection.
const ORDERS: i32 = 3;
/// Entries of the table of sensitivities, and the largest phase `2 pi OPD` in it, nm.
const ENTRIES: usize = 512;
const LARGEST_PHASE: f32 = 60_000.0;
/// Linear Rec.709 from XYZ.
const REC709_FROM_XYZ: Mat3 = Mat3::from_cols(
    Vec3::new(3.240_454_2, -0.969_266, 0.055_643_4),
    Vec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
    Vec3::new(-0.498_531_4, 0.041_556, 1.057_225_2),
);
/// XYZ of white, which a spectrum without colour becomes.
const WHITE: Vec3 = Vec3::new(0.950_47, 1.0, 1.088_83);

/// A film between air and a surface.
#[derive(Clone, Copy, Debug)]
pub struct Film {
    thickness: f32,
    ior: f32,
    model: FilmModel,
}

/// Reflectances of the two polarisations, or cosines and sines of their phase shifts.
type Pair = [f32; 2];

impl Film {
    /// A film of a thickness in nm, with its index of refraction over that of the side of the ray; nothing if it is too thin.
    pub fn new(thickness: f32, ior: f32, model: FilmModel) -> Option<Self> {
        (thickness > THINNEST).then_some(Self { thickness, ior, model })
    }

    /// The film as seen from within a body of index of refraction `ior`.
    pub fn from_within(self, ior: f32) -> Self {
        Self { ior: self.ior / ior, ..self }
    }

    /// Index of refraction, which approaches that of air where waves do not fit into the film.
    fn effective_ior(&self) -> f32 {
        let fades_below = match self.model {
            FilmModel::Fitted => 30.0,
            FilmModel::Tabulated => 1.0,
        };
        let x = (self.thickness / fades_below).min(1.0);
        1.0 + (self.ior - 1.0) * (x * x * (3.0 - 2.0 * x))
    }

    /// Reflectance of a film upon a dielectric of relative index `ior`.
    pub fn on_dielectric(&self, cos: f32, ior: f32) -> Vec3 {
        let film = self.effective_ior();
        let Some((top, top_phase, cos_film)) = polarised(cos, film) else { return Vec3::ONE };
        let Some((bottom, bottom_phase, _)) = polarised(cos_film, ior / film) else { return Vec3::ONE };
        let difference = 2.0 * film * self.thickness * cos_film;
        let by_polarisation = [0, 1].map(|p| {
            let phase = [-top_phase[p] * bottom_phase[p], 0.0];
            self.airy(top[p], Vec3::splat(bottom[p]), difference, [phase; 3])
        });
        self.seen(by_polarisation)
    }

    /// Reflectance of a film upon a dielectric, scaled as far as it is near that of the bare one head on, which becomes `f0`;
    /// and cosine of the refracted angle.
    pub fn stretched(&self, cos: f32, ior: f32, f0: Vec3) -> (Vec3, f32) {
        let (reflected, cos_t) = (self.on_dielectric(cos, ior), dielectric(cos, ior).1);
        let real = f0_from_ior(ior);
        if real <= 1e-5 || reflected == Vec3::ONE {
            return (reflected, cos_t);
        }
        let nearness = ((1.0 - reflected) / (1.0 - real)).clamp(Vec3::ZERO, Vec3::ONE);
        (reflected * (1.0 + (f0 / real - 1.0) * nearness), cos_t)
    }

    /// Reflectance of a film upon a metal.
    pub fn on_conductor(&self, cos: f32, metal: &Conductor) -> Vec3 {
        self.on_absorbing(cos, metal, None)
    }

    /// Reflectance of a film upon a metal by its colours, whose index of refraction is that of Gulbrandsen, "Artist Friendly
    /// Metallic Fresnel" (2014).
    pub fn on_metal(&self, cos: f32, metal: &F82) -> Vec3 {
        let f0 = metal.f0.min(Vec3::splat(0.999));
        let edge = metal.reflectance(1.0 / 7.0);
        let root = f0.map(f32::sqrt);
        let (low, high) = ((1.0 + root) / (1.0 - root), (1.0 - f0) / (1.0 + f0));
        let ior = low + (high - low) * edge;
        let squares = f0 * (ior + 1.0) * (ior + 1.0) - (ior - 1.0) * (ior - 1.0);
        let extinction = (squares / (1.0 - f0)).max(Vec3::ZERO).map(f32::sqrt);
        self.on_absorbing(cos, &Conductor { ior, extinction }, Some(edge))
    }

    fn on_absorbing(&self, cos: f32, metal: &Conductor, edge: Option<Vec3>) -> Vec3 {
        let film = self.effective_ior();
        let Some((top, top_phase, cos_film)) = polarised(cos, film) else { return Vec3::ONE };
        let difference = 2.0 * film * self.thickness * cos_film;
        let channels = [0, 1, 2]
            .map(|c| absorbing(cos_film, film, metal.ior[c], metal.extinction[c], edge.map(|edge| edge[c])));
        let by_polarisation = [0, 1].map(|p| {
            let bottom = Vec3::from_array(channels.map(|(reflected, _)| reflected[p]));
            let phases = channels.map(|(_, phase)| phase[p].map(|part| -top_phase[p] * part));
            self.airy(top[p], bottom, difference, phases)
        });
        self.seen(by_polarisation)
    }

    /// Sum over orders of reflection (equation 10), with a complex phase shift for each channel.
    fn airy(&self, top: f32, bottom: Vec3, difference: f32, phases: [Pair; 3]) -> Vec3 {
        let through = 1.0 - top;
        let both = (bottom * top).min(Vec3::splat(1.0 - f32::EPSILON));
        let direct = bottom * (through * through) / (1.0 - both);
        let mut reflected = direct + top;
        let mut factor = direct - through;
        let mut turned = phases;
        for order in 1..=ORDERS {
            factor *= both.map(f32::sqrt);
            let (cosines, sines) = self.sensitivity(order as f32 * difference);
            let seen = cosines * Vec3::from_array(turned.map(|[re, _]| re))
                - sines * Vec3::from_array(turned.map(|[_, im]| im));
            reflected += 2.0 * factor * seen;
            for (turned, [re, im]) in turned.iter_mut().zip(phases) {
                *turned = [turned[0] * re - turned[1] * im, turned[0] * im + turned[1] * re];
            }
        }
        reflected
    }

    /// Mean of both polarisations, as linear Rec.709.
    fn seen(&self, [s, p]: [Vec3; 2]) -> Vec3 {
        (0.5 * (s + p)).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Cosine and sine transform of what red, green and blue see, at an OPD in nm.
    fn sensitivity(&self, difference: f32) -> (Vec3, Vec3) {
        match self.model {
            FilmModel::Fitted => (REC709_FROM_XYZ * (WHITE * fitted(difference)), Vec3::ZERO),
            FilmModel::Tabulated => {
                let table = TABLE.get_or_init(tabulate);
                let place = (TAU * difference / LARGEST_PHASE).clamp(0.0, 1.0) * (ENTRIES - 1) as f32;
                let first = (place as usize).min(ENTRIES - 2);
                let at = |part: usize| table[first][part].lerp(table[first + 1][part], place - first as f32);
                (at(0), at(1))
            }
        }
    }
}

/// Cosine transform of Gaussians that fit X, Y and Z, from the code that comes with the paper.
fn fitted(difference: f32) -> Vec3 {
    let phase = TAU * difference * 1e-9;
    let spread = phase * phase;
    let (height, place, variance) = (
        Vec3::new(5.4856e-13, 4.4201e-13, 5.2481e-13),
        Vec3::new(1.6810e6, 1.7953e6, 2.2084e6),
        Vec3::new(4.3278e9, 9.3046e9, 6.6121e9),
    );
    let mut xyz = height
        * (variance * TAU).map(f32::sqrt)
        * (place * phase).map(f32::cos)
        * (variance * -spread).map(f32::exp);
    xyz.x += 1.64408e-8 * (2.2399e6 * phase).cos() * (-4.5282e9 * spread).exp();
    xyz / 1.0685e-7
}

static TABLE: OnceLock<Vec<[Vec3; 2]>> = OnceLock::new();

/// Cosine and sine transforms of the observer's sensitivities, with which a spectrum without colour is white.
fn tabulate() -> Vec<[Vec3; 2]> {
    let colors: Vec<Vec3> = MATCHING.iter().map(|xyz| REC709_FROM_XYZ * Vec3::from_array(*xyz)).collect();
    let white: Vec3 = colors.iter().sum();
    let entry = |number: usize| {
        let phase = LARGEST_PHASE * number as f32 / (ENTRIES - 1) as f32;
        let mut sums = [Vec3::ZERO; 2];
        for (color, step) in colors.iter().zip(0u8..) {
            let (sin, cos) = (phase / (FIRST_NM + STEP_NM * f32::from(step))).sin_cos();
            sums[0] += *color / white * cos;
            sums[1] += *color / white * sin;
        }
        sums
    };
    (0..ENTRIES).map(entry).collect()
}

/// Reflectances of a dielectric for both polarisations, the cosines of their phase shifts and that of the refracted angle;
/// nothing if all is reflected.
fn polarised(cos: f32, eta: f32) -> Option<(Pair, Pair, f32)> {
    let (total, cos_t) = dielectric(cos, eta);
    if total >= 1.0 {
        return None;
    }
    let s = (cos - eta * cos_t) / (cos + eta * cos_t);
    let p = (eta * cos - cos_t) / (eta * cos + cos_t);
    let sign = |amplitude: f32| if amplitude >= 0.0 { 1.0 } else { -1.0 };
    Some(([s * s, p * p], [sign(s), sign(p)], cos_t))
}

/// Reflectances of a metal within a film and the complex phase shifts, for both polarisations (Born and Wolf, "Principles of
/// Optics", 14.4.1); by a curve through `edge` at 82 degrees where that is given.
fn absorbing(cos: f32, film: f32, n: f32, k: f32, edge: Option<f32>) -> (Pair, [Pair; 2]) {
    let (film2, n2, k2, nk2) = (film * film, n * n, k * k, 2.0 * n * k);
    let t1 = n2 - k2 - film2 * (1.0 - cos * cos);
    let t2 = (t1 * t1 + nk2 * nk2).sqrt();
    let (u2, v2) = ((0.5 * (t2 + t1)).max(0.0), (0.5 * (t2 - t1)).max(0.0));
    let (u, v) = (u2.sqrt(), v2.sqrt());
    let ratio = |a: f32, b: f32| if b == 0.0 { 0.0 } else { a / b };
    let squared = |a: f32| a * a;
    let reflected = match edge {
        Some(edge) => {
            let (n, k2) = (n / film, k2 / film2);
            let f0 = (squared(n - 1.0) + k2) / (squared(n + 1.0) + k2);
            [F82::through(f0, edge).reflectance(cos).x; 2]
        }
        None => {
            let s = ratio(squared(film * cos - u) + v2, squared(film * cos + u) + v2);
            let (t3, t4) = ((n2 - k2) * cos, nk2 * cos);
            let p = ratio(
                squared(t3 - film * u) + squared(t4 - film * v),
                squared(t3 + film * u) + squared(t4 + film * v),
            );
            [s, p]
        }
    };
    let unit = |re: f32, im: f32| {
        let length = re.hypot(im);
        if length == 0.0 { [1.0, 0.0] } else { [re / length, im / length] }
    };
    let s = unit(film2 * cos * cos - u2 - v2, -2.0 * film * cos * v);
    let p = unit(squared((n2 + k2) * cos) - film2 * (u2 + v2), 2.0 * film * cos * (nk2 * u - (n2 - k2) * v));
    (reflected, [s, p])
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODELS: [FilmModel; 2] = [FilmModel::Fitted, FilmModel::Tabulated];

    #[test]
    fn a_film_of_the_index_of_air_is_none() {
        for model in MODELS {
            let film = Film::new(500.0, 1.0, model).unwrap();
            let metal = Conductor { ior: Vec3::new(0.2, 0.9, 1.1), extinction: Vec3::new(3.9, 2.4, 2.2) };
            for cos in [0.2, 0.6, 1.0] {
                let bare = dielectric(cos, 1.5).0;
                assert!((film.on_dielectric(cos, 1.5) - bare).abs().max_element() < 1e-4, "{model:?}");
                let difference = film.on_conductor(cos, &metal) - metal.reflectance(cos);
                assert!(difference.abs().max_element() < 1e-4, "{model:?}: {difference}");
            }
        }
    }

    /// The Airy formula at each wavelength, as an observer sees it who takes a constant spectrum for white.
    #[test]
    fn the_table_agrees_with_a_sum_over_wavelengths() {
        let (thickness, ior, base) = (400.0, 1.33, 1.5);
        let film = Film::new(thickness, ior, FilmModel::Tabulated).unwrap();
        for cos in [0.3_f32, 0.7, 1.0] {
            let (top, top_phase, cos_film) = polarised(cos, ior).unwrap();
            let (bottom, bottom_phase, _) = polarised(cos_film, base / ior).unwrap();
            let (mut sum, mut white) = (Vec3::ZERO, Vec3::ZERO);
            for (xyz, step) in MATCHING.iter().zip(0u8..) {
                let phase = TAU * 2.0 * ior * thickness * cos_film / (FIRST_NM + STEP_NM * f32::from(step));
                let reflected: f32 = (0..2)
                    .map(|p| {
                        // Amplitudes of both interfaces; the path between adds the phase.
                        let (a, b) = (top[p].sqrt() * top_phase[p], bottom[p].sqrt() * bottom_phase[p]);
                        let (cross, product) = (2.0 * a * b * phase.cos(), a * b);
                        (a * a + b * b + cross) / (1.0 + product * product + cross)
                    })
                    .sum::<f32>()
                    * 0.5;
                let color = REC709_FROM_XYZ * Vec3::from_array(*xyz);
                sum += color * reflected;
                white += color;
            }
            let found = film.on_dielectric(cos, base);
            assert!((found - sum / white).abs().max_element() < 2e-3, "{found} {}", sum / white);
        }
    }

    #[test]
    fn nothing_passes_beyond_the_critical_angle_of_the_base() {
        for model in MODELS {
            let film = Film::new(300.0, 1.4, model).unwrap().from_within(1.5);
            assert_eq!(film.on_dielectric(0.3, 1.0 / 1.5), Vec3::ONE);
        }
    }
}
