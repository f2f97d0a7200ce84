use crate::analytic::{Dual, EightLanes, FEATURES, PixelSurface, Real, features, seen_params, seen_values};
use crate::encoding::LightEncoding;
use crate::light::Form;
use crate::scene_cache::{SURFACE, surface_lanes};
use crate::simd::{Isa, LANES};
use crate::{LightParams, MAX_PARAMS};

/// Analytic features of a light at a tile of surfaces, into a tile of [`FEATURES`] rows.
pub(crate) fn feature_tile(
    isa: Isa,
    encoding: &LightEncoding,
    light: &LightParams,
    surfaces: &[f32],
    out: &mut [f32],
) {
    let (form, params) = (light.kind().form(), seen_values(light, &encoding.normalisation));
    match isa {
        // SAFETY: `Isa::available` hands these out only where the instructions exist.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 | Isa::Avx512 => unsafe { feature_tile_avx2(form, &params, surfaces, out) },
        Isa::Portable => feature_tile_body(form, &params, surfaces, out),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn feature_tile_avx2(form: Form, params: &[f32; MAX_PARAMS], surfaces: &[f32], out: &mut [f32]) {
    feature_tile_body(form, params, surfaces, out);
}

#[inline(always)]
fn feature_tile_body(form: Form, params: &[f32; MAX_PARAMS], surfaces: &[f32], out: &mut [f32]) {
    let light = params.map(EightLanes::constant);
    for lane in (0..LANES).step_by(8) {
        let values = features(form, &light, &surface_lanes(surfaces, lane));
        for (row, value) in values.iter().enumerate() {
            out[row * LANES + lane..row * LANES + lane + 8].copy_from_slice(&value.0);
        }
    }
}

/// Adds the gradient by the light's parameters, from the gradient `d_features` by a tile of features, to `gradient`.
pub(crate) fn features_backward(
    encoding: &LightEncoding,
    light: &LightParams,
    surfaces: &[f32],
    d_features: &[f32],
    gradient: &mut [f32],
) {
    assert_eq!(surfaces.len(), SURFACE * LANES, "surfaces");
    let (form, params) = (light.kind().form(), seen_params(light, &encoding.normalisation));
    for lane in 0..LANES {
        let row = |row: usize| Dual::constant(surfaces[row * LANES + lane]);
        let at = PixelSurface {
            position: [row(0), row(1), row(2)],
            normal: [row(3), row(4), row(5)],
            mirror: [row(6), row(7), row(8)],
        };
        let values: [Dual; FEATURES] = features(form, &params, &at);
        for (index, value) in values.iter().enumerate() {
            let d = d_features[index * LANES + lane];
            for (sum, slope) in gradient.iter_mut().zip(value.d) {
                *sum += d * slope;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::light::{HALF_ANGLES, random_light_facing_down};
    use crate::scene_cache::Normalisation;
    use crate::{LightKind, Rng, SizeRange};

    /// Surfaces on the floor, lights above it.
    fn surfaces(rng: &mut Rng) -> Vec<f32> {
        let mut tile = vec![0.0; SURFACE * LANES];
        for lane in 0..LANES {
            for row in 0..2 {
                tile[row * LANES + lane] = rng.next_normal();
            }
            tile[5 * LANES + lane] = 1.0;
            tile[6 * LANES + lane] = 0.6;
            tile[8 * LANES + lane] = 0.8;
        }
        tile
    }

    #[test]
    fn feature_gradients_equal_difference_quotients() {
        let normalisation = Normalisation { center: [0.1, 0.2, 0.3], scale: 2.0, depth: 1.0 };
        let size = SizeRange { min: 0.2, max: 0.8 };
        let mut rng = Rng::stream(1, 1, 1);
        for kind in LightKind::ALL {
            let encoding = LightEncoding::new(kind, normalisation, size);
            let surfaces = surfaces(&mut rng);
            for _ in 0..20 {
                let center = Vec3::new(rng.next_normal(), rng.next_normal(), 3.0 + rng.next_f32());
                let light = random_light_facing_down(kind, center, size, &mut rng);
                let weights: Vec<f32> = (0..FEATURES * LANES).map(|_| rng.next_normal()).collect();
                let mut gradient = [0.0; MAX_PARAMS];
                features_backward(&encoding, &light, &surfaces, &weights, &mut gradient);
                let value = |params: &[f32]| {
                    let light = LightParams::from_slice(kind, params).expect("same length");
                    let mut out = vec![0.0; FEATURES * LANES];
                    feature_tile(Isa::detect(), &encoding, &light, &surfaces, &mut out);
                    out.iter().zip(&weights).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>()
                };
                let scale = gradient.iter().fold(0.1f32, |m, g| m.max(g.abs()));
                for index in 0..kind.param_count() {
                    let moved = |step: f32| {
                        let mut params = light.as_slice().to_vec();
                        params[index] += step;
                        value(&params)
                    };
                    let found = (moved(4e-3) - moved(-4e-3)) / 8e-3;
                    let error = (found - f64::from(gradient[index])).abs();
                    assert!(
                        error < 0.02 * f64::from(scale),
                        "{kind}, parameter {index}: difference quotient {found}, gradient {}",
                        gradient[index]
                    );
                }
            }
        }
    }

    #[test]
    fn features_stay_finite_on_and_inside_the_light() {
        let normalisation = Normalisation { center: [0.0; 3], scale: 1.0, depth: 1.0 };
        let size = SizeRange { min: 0.1, max: 1.0 };
        let surfaces = vec![0.0; SURFACE * LANES];
        for isa in Isa::available() {
            for light in [
                LightParams::round(LightKind::Sphere, Vec3::ZERO, 0.1),
                LightParams::quad(Vec3::ZERO, Vec3::X, Vec3::Y),
                LightParams::quad(Vec3::new(0.5, 0.5, 0.0), Vec3::X, Vec3::Y),
                LightParams::facing_down(LightKind::Ellipse, Vec3::ZERO, 1.0),
                LightParams::facing_down(LightKind::Spot, Vec3::ZERO, 0.1),
                LightParams::spot(LightKind::Spot, Vec3::Z, 0.1, [HALF_ANGLES[0], 0.0], Vec3::Z),
            ] {
                let encoding = LightEncoding::new(light.kind(), normalisation, size);
                let mut out = vec![f32::NAN; FEATURES * LANES];
                feature_tile(isa, &encoding, &light, &surfaces, &mut out);
                assert!(out.iter().all(|x| x.abs() < 1e3), "{} {light:?}: {out:?}", isa.name());
                let mut gradient = [0.0; MAX_PARAMS];
                features_backward(&encoding, &light, &surfaces, &out, &mut gradient);
                assert!(gradient.iter().all(|g| g.is_finite()), "{light:?}: {gradient:?}");
            }
        }
    }

    /// Irradiance per area that the features hold of a light, at the origin of a floor.
    fn irradiance(light: &LightParams) -> f64 {
        let normalisation = Normalisation { center: [0.0; 3], scale: 1.0, depth: 1.0 };
        let encoding = LightEncoding::new(light.kind(), normalisation, SizeRange { min: 0.1, max: 2.0 });
        let mut surfaces = vec![0.0; SURFACE * LANES];
        surfaces[5 * LANES..6 * LANES].fill(1.0);
        let mut out = vec![0.0; FEATURES * LANES];
        feature_tile(Isa::Portable, &encoding, light, &surfaces, &mut out);
        let compressed = f64::from(out[8 * LANES]);
        compressed / (1.0 - compressed)
    }

    /// Irradiance of a flat light by a sum over its points, of which an ellipse has those within it.
    fn sum_over_points(is_ellipse: bool, center: Vec3, u: Vec3, v: Vec3) -> f64 {
        let n = 200;
        let at = |k: usize| (k as f32 + 0.5) / n as f32 - 0.5;
        let places = (0..n * n).map(|i| (at(i % n), at(i / n)));
        let within: Vec<_> = places.filter(|(x, y)| !is_ellipse || x * x + y * y < 0.25).collect();
        let sum = within.iter().map(|(x, y)| {
            let point = center + u * *x + v * *y;
            let (squared, emitter) = (point.length_squared(), u.cross(v).normalize());
            let cosines = point.z * emitter.dot(-point) / squared;
            f64::from(cosines.max(0.0) / squared)
        });
        sum.sum::<f64>() / within.len() as f64
    }

    #[test]
    fn irradiance_of_flat_lights_equals_a_sum_over_their_points() {
        let (center, u, v) = (Vec3::new(0.3, 0.2, 1.0), Vec3::new(1.0, 0.0, 0.3), Vec3::new(0.0, -1.2, 0.0));
        let (found, expected) =
            (irradiance(&LightParams::quad(center, u, v)), sum_over_points(false, center, u, v));
        assert!((found - expected).abs() < 2e-3 * expected, "irradiance {found} instead of {expected}");

        // An ellipse counts as the rectangle of its area.
        for (height, most) in [(0.25, 0.01), (0.5, 0.01), (1.0, 0.01), (2.0, 3e-3)] {
            let place = Vec3::new(0.2, 0.1, height);
            let ellipse = LightParams::flat(LightKind::Ellipse, place, Vec3::X, 0.7 * Vec3::NEG_Y);
            let expected = sum_over_points(true, place, Vec3::X, 0.7 * Vec3::NEG_Y);
            let error = (irradiance(&ellipse) / expected - 1.0).abs();
            assert!(error < most, "{height} m: {error}");
        }
    }

    #[test]
    fn a_cone_lets_through_what_cycles_lets_through() {
        let (radius, half_angle, blend) = (1e-3f32, 0.6f32, 0.7);
        for angle in [0.0f32, 0.3, 0.45, 0.55, 0.7, 2.0] {
            let axis = Vec3::new(angle.sin(), 0.0, -angle.cos());
            let light = LightParams::spot(LightKind::Spot, Vec3::Z, radius, [half_angle, blend], axis);
            let edge = half_angle.cos();
            let x = ((angle.cos() - edge) / ((1.0 - edge) * blend)).clamp(0.0, 1.0);
            let (found, expected) = (irradiance(&light), f64::from(x * x * (3.0 - 2.0 * x)));
            // The edge is wider by a twentieth of the cone on both sides.
            assert!((found - expected).abs() < 0.1, "{angle}: {found} instead of {expected}");
            assert!(angle < 0.7 || found == 0.0, "{angle}: {found}");
        }
    }
}
