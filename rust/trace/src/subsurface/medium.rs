//! The inside of a body that has a given albedo from outside.

use glam::Vec3;
use relume_scene::{AlbedoInversion, SubsurfaceMethod};

use crate::bsdf::Bssrdf;

/// Largest share of light that scatters rather than is absorbed, for precision.
const MOST_ALBEDO: f32 = 0.999_999;
/// Least share: with less, hardly any path would come out.
const LEAST_ALBEDO: f32 = 0.2;
const LEAST_RADIUS: f32 = 1e-16;

/// A homogeneous medium. Coefficients are per metre.
#[derive(Clone, Copy, Debug)]
pub(super) struct Medium {
    pub extinction: Vec3,
    pub scattering: Vec3,
    /// Scattering as a share of extinction.
    pub albedo: Vec3,
    /// Mean cosine of scattering.
    pub anisotropy: f32,
}

impl Medium {
    /// The inside of `bssrdf`, and the throughput of a path that has entered it: `throughput` without the albedo,
    /// which comes from scattering.
    pub fn new(bssrdf: &Bssrdf, throughput: Vec3) -> (Self, Vec3) {
        let (color, g) = (bssrdf.albedo, bssrdf.anisotropy);
        let has_polynomial = bssrdf.inversion == AlbedoInversion::Polynomial && g >= 0.0;
        let albedo = color.map(|a| if has_polynomial { by_polynomial(a, g) } else { by_van_de_hulst(a, g) });
        let albedo = albedo.clamp(Vec3::ZERO, Vec3::splat(MOST_ALBEDO));
        let radius = match bssrdf.method {
            SubsurfaceMethod::Skin => bssrdf.radius * color.map(|a| dipole_factor(a, bssrdf.ior)),
            _ => bssrdf.radius,
        };
        let reduced = if has_polynomial { 1.0 / (1.0 - g) } else { 1.0 };
        let extinction = reduced / radius.max(Vec3::splat(LEAST_RADIUS));
        let throughput = Vec3::select(color.cmpgt(Vec3::ZERO), throughput / color, Vec3::ZERO);
        let raised = albedo.max(Vec3::splat(LEAST_ALBEDO));
        let medium = Self { extinction, scattering: extinction * raised, albedo: raised, anisotropy: g };
        (medium, throughput * albedo / raised)
    }
}

/// Albedo of single scattering: d'Eon, "A Hitchhiker's Guide to Multiple Scattering", version 0.3.2, equation 53.7.
fn by_van_de_hulst(color: f32, g: f32) -> f32 {
    let s = 4.208_63 * color - (9.592_17 + (41.6808 + 17.7126 * color) * color).sqrt() + 4.097_12;
    let denominator = 1.0 - g * s * s;
    if denominator == 0.0 { 0.0 } else { (1.0 - s * s) / denominator }
}

/// Albedo of single scattering: the fit of Wrenninge, Villemin and Hery, "Path Traced Subsurface Scattering using
/// Anisotropic Phase Functions and Non-Exponential Free Flights" (Pixar technical memo 17-07, 2017).
fn by_polynomial(color: f32, g: f32) -> f32 {
    let of_g = |coefficients: [f32; 8]| coefficients.into_iter().rev().fold(0.0, |sum, c| sum * g + c);
    let a = of_g([
        1.826_052_4,
        -1.284_510_6,
        -1.799_046_3,
        9.193_933,
        -22.821_558,
        32.023_487,
        -23.626_48,
        7.210_67,
    ]);
    let b = 4.985_111_7
        + 0.127_355_96
            * of_g([
                0.0,
                31.149_158,
                -201.847_02,
                841.576,
                -2_018.092_9,
                2_731.715_6,
                -1_935.414_2,
                559.009_03,
            ])
            .exp();
    let c = of_g([
        1.096_861,
        -0.394_704_07,
        1.052_581_2,
        -8.839_637,
        28.864_323,
        -46.880_29,
        38.540_283,
        -12.718_104,
    ]);
    let d = of_g([
        0.496_310_2,
        0.360_146_58,
        -2.151_393_2,
        17.889_69,
        -55.298_4,
        82.065_98,
        -58.510_6,
        15.847_83,
    ]);
    let e = 4.231_903
        + 0.003_106_039_5
            * of_g([
                0.0,
                76.731_63,
                -594.356_75,
                2_448.883_3,
                -5_576.685,
                7_116.601_6,
                -4_763.545,
                1_303.531_9,
            ])
            .exp();
    let f =
        of_g([2.406_03, -2.518_148_4, 9.184_949, -79.219_17, 259.082_86, -403.613_8, 302.857_12, -87.437_05]);
    let blend = color.powf(0.25);
    (1.0 - blend) * a * (b * color).atan().powf(c) + blend * d * (e * color).atan().powf(f)
}

/// Factor on the radius of skin: `sqrt(3 (1 - a'))` with the reduced albedo `a'` of a dipole that reflects `color`
/// (Jensen et al., "A Practical Model for Subsurface Light Transport", SIGGRAPH 2001), by as many bisections as in
/// Cycles.
fn dipole_factor(color: f32, ior: f32) -> f32 {
    let diffuse_fresnel = (-1.44 / ior + 0.71) / ior + 0.668 + 0.0636 * ior;
    let exponent = 4.0 / 3.0 * (1.0 + diffuse_fresnel) / (1.0 - diffuse_fresnel);
    let reflected = |albedo: f32| {
        let s = (3.0 * (1.0 - albedo)).sqrt();
        0.5 * albedo * (1.0 + (-exponent * s).exp()) * (-s).exp()
    };
    let albedo = if color < 1e-4 {
        0.0
    } else if color >= 0.995 {
        MOST_ALBEDO
    } else {
        let (mut low, mut high, mut middle) = (0.0, 1.0, 0.5);
        for _ in 0..12 {
            middle = 0.5 * (low + high);
            if reflected(middle) < color {
                low = middle;
            } else {
                high = middle;
            }
        }
        middle
    };
    (3.0 * (1.0 - albedo)).sqrt()
}
