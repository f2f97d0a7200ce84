//! Absorption within a fibre, in units of its inverse radius, from what an artist sets.

use glam::Vec3;

/// Absorption of eumelanin, brown and black, for a concentration of 1: d'Eon et al. (2011), table 1, made linear Rec.709 as in
/// Chiang et al. (2016).
const EUMELANIN: Vec3 = Vec3::new(0.506, 0.841, 1.653);
/// Absorption of pheomelanin, red, likewise.
const PHEOMELANIN: Vec3 = Vec3::new(0.343, 0.733, 1.924);

/// Absorption by which thick hair looks like `color`, at an azimuthal roughness: Chiang et al. (2016), equation 9.
pub fn absorption_of_color(color: Vec3, radial_roughness: f32) -> Vec3 {
    let x = radial_roughness;
    let scale = ((((0.245 * x + 5.574) * x - 10.73) * x + 2.532) * x - 0.215) * x + 5.969;
    let root = color.max(Vec3::splat(f32::MIN_POSITIVE)).map(f32::ln) / scale;
    root * root
}

/// Absorption of melanin, whose amount and share of red pigment are 0..1; Blender's scale of amounts, which looks even.
pub fn absorption_of_melanin(amount: f32, redness: f32) -> Vec3 {
    let concentration = -(1.0 - amount).max(1e-4).ln();
    concentration * (EUMELANIN * (1.0 - redness) + PHEOMELANIN * redness)
}
