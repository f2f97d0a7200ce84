use crate::analytic::{Dual, EightLanes, FEATURES, PixelSurface, Real, features, scaled_params};
use crate::encoding::{LightEncoding, dual_params};
use crate::scene_cache::{SURFACE, surface_lanes};
use crate::simd::{Isa, LANES};
use crate::{LightKind, LightParams, MAX_PARAMS};

/// Analytic features of a light at a tile of surfaces, into a tile of [`FEATURES`] rows.
pub(crate) fn feature_tile(
    isa: Isa,
    encoding: &LightEncoding,
    light: &LightParams,
    surfaces: &[f32],
    out: &mut [f32],
) {
    let n = &encoding.normalisation;
    let params = scaled_params(light, n.center, n.scale);
    match isa {
        // SAFETY: `Isa::available` hands these out only where the instructions exist.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 | Isa::Avx512 => unsafe { feature_tile_avx2(light.kind(), &params, surfaces, out) },
        Isa::Portable => feature_tile_body(light.kind(), &params, surfaces, out),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn feature_tile_avx2(kind: LightKind, params: &[f32; MAX_PARAMS], surfaces: &[f32], out: &mut [f32]) {
    feature_tile_body(kind, params, surfaces, out);
}

#[inline(always)]
fn feature_tile_body(kind: LightKind, params: &[f32; MAX_PARAMS], surfaces: &[f32], out: &mut [f32]) {
    let light = params.map(EightLanes::constant);
    for lane in (0..LANES).step_by(8) {
        let values = features(kind, &light, &surface_lanes(surfaces, lane));
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
    let n = &encoding.normalisation;
    let inverse = Dual::constant(1.0 / n.scale);
    let mut params = dual_params(light);
    for (i, p) in params.iter_mut().enumerate() {
        let origin = if i < 3 { n.center[i] } else { 0.0 };
        *p = (*p - Dual::constant(origin)) * inverse;
    }
    for lane in 0..LANES {
        let row = |row: usize| Dual::constant(surfaces[row * LANES + lane]);
        let at = PixelSurface {
            position: [row(0), row(1), row(2)],
            normal: [row(3), row(4), row(5)],
            mirror: [row(6), row(7), row(8)],
        };
        let values: [Dual; FEATURES] = features(light.kind(), &params, &at);
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
    use super::*;
    use crate::light::random_light_facing_down;
    use crate::scene_cache::Normalisation;
    use crate::{Rng, SizeRange};

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
        for kind in [LightKind::Sphere, LightKind::FacingDisk, LightKind::Quad] {
            let encoding = LightEncoding::new(kind, normalisation, size);
            let surfaces = surfaces(&mut rng);
            for _ in 0..20 {
                let center = glam::Vec3::new(rng.next_normal(), rng.next_normal(), 3.0 + rng.next_f32());
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
                LightParams::round(LightKind::Sphere, glam::Vec3::ZERO, 0.1),
                LightParams::quad(glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y),
                LightParams::quad(glam::Vec3::new(0.5, 0.5, 0.0), glam::Vec3::X, glam::Vec3::Y),
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

    #[test]
    fn quad_irradiance_equals_a_sum_over_its_points() {
        let normalisation = Normalisation { center: [0.0; 3], scale: 1.0, depth: 1.0 };
        let encoding = LightEncoding::new(LightKind::Quad, normalisation, SizeRange { min: 0.1, max: 2.0 });
        let (center, u, v) =
            (glam::Vec3::new(0.3, 0.2, 1.0), glam::Vec3::new(1.0, 0.0, 0.3), glam::Vec3::new(0.0, -1.2, 0.0));
        let mut surfaces = vec![0.0; SURFACE * LANES];
        surfaces[5 * LANES..6 * LANES].fill(1.0);
        let mut out = vec![0.0; FEATURES * LANES];
        feature_tile(Isa::Portable, &encoding, &LightParams::quad(center, u, v), &surfaces, &mut out);
        let n = 200;
        let mut expected = 0.0f64;
        for i in 0..n * n {
            let at = |k: usize| (k as f32 + 0.5) / n as f32 - 0.5;
            let point = center + u * at(i % n) + v * at(i / n);
            let (squared, emitter) = (point.length_squared(), u.cross(v).normalize());
            let cosines = point.z * emitter.dot(-point) / squared;
            expected += f64::from(cosines.max(0.0) / squared) / (n * n) as f64;
        }
        let compressed = f64::from(out[8 * LANES]);
        let found = compressed / (1.0 - compressed);
        assert!((found - expected).abs() < 2e-3 * expected, "irradiance {found} instead of {expected}");
    }
}
