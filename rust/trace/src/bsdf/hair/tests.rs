use std::f32::consts::{FRAC_PI_2, PI, TAU};

use super::scattering::{Azimuthal, longitudinal, sample_longitudinal, scaled_bessel_i0};
use super::*;
use crate::bsdf::tests::{Random, facing, views};
use crate::bsdf::{Scatter, Surface};

const ALONG: Vec3 = Vec3::new(0.6, 0.8, 0.0);

/// Fibre in the plane z = 0, met at a place across it.
fn fibre_at(offset: f32, wo: Vec3) -> Fibre {
    Fibre { offset, ..Fibre::new(ALONG, Vec3::Z, wo) }
}

const CHIANG: ChiangParameters = ChiangParameters {
    roughness: 0.3,
    radial_roughness: 0.4,
    coat: 0.3,
    ior: 1.55,
    tilt: 0.035,
    absorption: Vec3::new(0.2, 0.4, 0.9),
};

const HUANG: HuangParameters = HuangParameters {
    roughness: 0.3,
    aspect_ratio: 0.85,
    major: Vec3::new(0.3, -0.5, 0.8),
    ior: 1.55,
    tilt: 0.035,
    absorption: Vec3::new(0.2, 0.4, 0.9),
    factors: [1.0; 3],
    coverage: 1.0,
};

/// Brown hair met at a place across it.
pub fn chiang(offset: f32, roughness: f32, wo: Vec3) -> Hair {
    let parameters = ChiangParameters { roughness, ..CHIANG };
    Hair::Chiang(Chiang::new(fibre_at(offset, wo), &parameters, wo))
}

/// Lobe of a Hair BSDF.
pub fn lobe(side: HairSide, wo: Vec3) -> Hair {
    Hair::Lobe(HairLobe::new(fibre_at(0.0, wo), Vec3::Z, side, 0.1, (0.3, 0.6), wo))
}

fn huang(parameters: &HuangParameters, wo: Vec3) -> Hair {
    Hair::Huang(Huang::new(fibre_at(0.1, wo), parameters, wo).expect("the middle is within the ellipse"))
}

fn surface(hair: Hair, wo: Vec3) -> Surface {
    let mut surface = facing(wo);
    assert!(surface.add(Vec3::ONE, Vec3::ONE, Vec3::Z, Scatter::Hair(hair)));
    surface
}

/// Means of functions of the direction over what comes back, and their standard errors.
fn means<const N: usize>(
    hair: &Hair,
    is_mixed: bool,
    samples: usize,
    functions: impl Fn(Vec3) -> [f32; N],
) -> [(f32, f32); N] {
    let mut random = Random(5);
    let mut sums = [(0.0, 0.0); N];
    for _ in 0..samples {
        if let Some((wi, _, response)) = hair.sample(random.next3(), is_mixed) {
            let weight = response.value().x / response.pdf();
            for (sum, function) in sums.iter_mut().zip(functions(wi)) {
                let value = f64::from(weight * function);
                *sum = (sum.0 + value, sum.1 + value * value);
            }
        }
    }
    let count = samples as f64;
    sums.map(|(sum, squares)| {
        let mean = sum / count;
        (mean as f32, ((squares / count - mean * mean) / count).sqrt() as f32)
    })
}

#[test]
fn the_bessel_function_is_that_of_its_series() {
    for x in [0.0f32, 0.5, 2.0, 3.7, 3.8, 10.0, 20.0] {
        let (mut term, mut sum) = (1.0f64, 1.0f64);
        for k in 1..80 {
            term *= f64::from(x * x) / 4.0 / f64::from(k * k);
            sum += term;
        }
        let expected = sum * f64::from(-x).exp();
        assert!((f64::from(scaled_bessel_i0(x)) / expected - 1.0).abs() < 1e-5, "{x}");
    }
}

#[test]
fn scattering_along_the_fibre_is_normalised_and_reciprocal() {
    for variance in [1e-4f32, 0.003, 0.1, 0.7, 4.0] {
        for theta_o in [-1.2f32, 0.0, 0.4] {
            let cone = theta_o.sin_cos();
            let steps = 40_000;
            let sum: f64 = (0..steps)
                .map(|step| {
                    let theta = PI * ((step as f32 + 0.5) / steps as f32 - 0.5);
                    f64::from(longitudinal(theta.sin_cos(), cone, variance) * theta.cos())
                })
                .sum();
            let integral = sum * std::f64::consts::PI / f64::from(steps);
            assert!((integral - 1.0).abs() < 2e-3, "variance {variance} at {theta_o}: {integral}");
            let other = 0.3f32.sin_cos();
            let (there, back) = (longitudinal(other, cone, variance), longitudinal(cone, other, variance));
            assert!((there - back).abs() <= 1e-4 * there, "{variance}: {there} {back}");
        }
    }
}

#[test]
fn angles_are_drawn_with_their_densities() {
    // Shares below the median angle, by quadrature and by sampling.
    let mut random = Random(3);
    let samples = 40_000;
    for variance in [0.01f32, 0.3] {
        let cone = 0.5f32.sin_cos();
        let drawn = (0..samples)
            .filter(|_| sample_longitudinal(cone, variance, [random.next(), random.next()]).0 < -0.45);
        let share = drawn.count() as f32 / samples as f32;
        let end = (-0.45f32).asin() + FRAC_PI_2;
        let expected: f32 = (0..4000)
            .map(|step| {
                let theta = end * (step as f32 + 0.5) / 4000.0 - FRAC_PI_2;
                longitudinal(theta.sin_cos(), cone, variance) * theta.cos() * end / 4000.0
            })
            .sum();
        assert!((share - expected).abs() < 0.012, "{variance}: {share} and {expected}");
    }
    for scale in [0.05f32, 0.4, 3.0] {
        let azimuthal = Azimuthal::new(scale);
        let drawn = (0..samples).filter(|_| azimuthal.sample(random.next()) < 0.1);
        let share = drawn.count() as f32 / samples as f32;
        let width = (PI + 0.1) / 4000.0;
        let expected: f32 =
            (0..4000).map(|step| azimuthal.density(-PI + width * (step as f32 + 0.5)) * width).sum();
        assert!((share - expected).abs() < 0.012, "{scale}: {share} and {expected}");
        assert!((azimuthal.density(0.3) / azimuthal.density(0.3 + 3.0 * TAU) - 1.0).abs() < 1e-3);
    }
}

#[test]
fn clear_hair_loses_nothing() {
    for wo in views() {
        for (offset, roughness) in [(0.0, 0.1), (0.6, 0.3), (-0.98, 1.0)] {
            let parameters = ChiangParameters { roughness, absorption: Vec3::ZERO, ..CHIANG };
            let hair = Hair::Chiang(Chiang::new(fibre_at(offset, wo), &parameters, wo));
            let [(returned, _)] = means(&hair, false, 2000, |_| [1.0]);
            assert!((returned - 1.0).abs() < 1e-3, "Chiang at {offset} from {wo}: {returned}");
        }
        // Tilted scales show more of themselves to some rays than to others.
        for (roughness, aspect_ratio) in [(0.1, 1.0), (0.3, 0.85), (0.5, 0.6)] {
            let parameters =
                HuangParameters { roughness, aspect_ratio, tilt: 0.0, absorption: Vec3::ZERO, ..HUANG };
            let [(returned, error)] = means(&huang(&parameters, wo), false, 20_000, |_| [1.0]);
            assert!(
                (returned - 1.0).abs() < 0.02 + 3.0 * error,
                "Huang {roughness} {aspect_ratio} from {wo}: {returned} +- {error}"
            );
        }
    }
}

#[test]
fn each_lobe_carries_what_it_should() {
    // Head on, in the middle: Fresnel's reflectance is (0.55 / 2.55)^2, and the way is a diameter.
    let wo = Vec3::Z;
    let Hair::Chiang(model) = chiang(0.0, 0.2, wo) else { unreachable!() };
    let f = (0.55f32 / 2.55).powi(2);
    let t = (CHIANG.absorption * -2.0).map(f32::exp);
    let series = f + (1.0 - f) * (1.0 - f) * t / (1.0 - f * t);
    assert!((model.albedo() - series).abs().max_element() < 1e-5, "{} {series}", model.albedo());
    // Reflection is alone in going back; its energy is that of the glossy class.
    let (glossy, error) = {
        let mut random = Random(9);
        let weights = (0..20_000).filter_map(|_| model.sample(random.next3())).map(|(wi, _)| {
            let response = model.eval(wi);
            response.glossy.x / response.pdf()
        });
        let weights: Vec<f32> = weights.collect();
        let mean = weights.iter().sum::<f32>() / weights.len() as f32;
        let variance = weights.iter().map(|w| (w - mean).powi(2)).sum::<f32>() / weights.len() as f32;
        (mean, (variance / weights.len() as f32).sqrt())
    };
    assert!((glossy - f).abs() < 4.0 * error, "{glossy} +- {error}, not {f}");
}

#[test]
fn reflection_of_the_hair_bsdf_goes_behind_the_normal_where_lights_do_not_count() {
    for wo in views() {
        let surface = surface(lobe(HairSide::Reflection, wo), wo);
        let mut random = Random(7);
        let samples: Vec<_> = (0..20_000).filter_map(|_| surface.sample(random.next3())).collect();
        assert!(samples.iter().all(|sample| sample.unlit || sample.wi.z >= 0.0), "{wo}");
        assert!(samples.iter().any(|sample| sample.unlit), "{wo}");
        let returned = samples.iter().map(|sample| sample.weight.x).sum::<f32>() / 20_000.0;
        assert!((returned - 1.0).abs() < 0.01, "{wo}: {returned}");
    }
}

#[test]
fn walks_through_the_fibre_are_what_evaluation_says() {
    // Cycles walks with what tilt and more than one reflection within are for lamps only roughly.
    let plain = HuangParameters { tilt: 0.0, factors: [1.0, 1.0, 0.0], ..HUANG };
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z];
    let lights = |wi: Vec3| axes.map(|axis| (0.5 + 0.5 * wi.dot(axis)).powi(8));
    for wo in views() {
        for parameters in [plain, HuangParameters { roughness: 0.15, aspect_ratio: 1.0, ..plain }] {
            let hair = huang(&parameters, wo);
            let walked = means(&hair, false, 40_000, lights);
            let evaluated = means(&hair, true, 20_000, lights);
            // Lamps' places across the fibre are few, as in Cycles, which shows where it is dark.
            let brightest = walked.iter().fold(0.0, |most: f32, (mean, _)| most.max(*mean));
            for ((walked, error), (evaluated, other)) in walked.into_iter().zip(evaluated) {
                assert!(
                    (walked - evaluated).abs() < 5.0 * error.hypot(other) + 0.01 * brightest,
                    "from {wo}: {walked} +- {error} and {evaluated} +- {other}"
                );
            }
        }
    }
}

#[test]
fn mixed_hair_follows_its_density() {
    // Shares of what is drawn towards some directions, by quadrature of the density and by drawing.
    let wo = views()[1];
    let hair = huang(&HUANG, wo);
    let Hair::Huang(model) = hair else { unreachable!() };
    let mut random = Random(6);
    for axis in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::Z, Vec3::NEG_Z] {
        let is_near = |wi: Vec3| wi.dot(axis) > 0.7;
        let drawn = (0..20_000).filter_map(|_| model.sample(random.next3()));
        let share = drawn.filter(|(wi, _)| is_near(*wi)).count() as f32 / 20_000.0;
        let mut expected = 0.0;
        for row in 0..200 {
            let z = (row as f32 + 0.5) / 100.0 - 1.0;
            for column in 0..400 {
                let (sin, cos) = (TAU * (column as f32 + 0.5) / 400.0).sin_cos();
                let across = (1.0 - z * z).sqrt();
                let wi = Vec3::new(across * cos, across * sin, z);
                if is_near(wi) {
                    expected += model.pdf(wi) * 4.0 * PI / 80_000.0;
                }
            }
        }
        assert!((share - expected).abs() < 0.012, "{axis}: {share} and {expected}");
    }
}

#[test]
fn ellipses_are_missed_beside_their_width() {
    let parameters = HuangParameters { aspect_ratio: 0.5, major: Vec3::Z, ..HUANG };
    for (wo, radius) in [(Vec3::Z, 0.5), (ALONG.cross(Vec3::Z), 1.0)] {
        let hits = |offset: f32| Huang::new(fibre_at(offset, wo), &parameters, wo).is_some();
        assert!(hits(radius - 0.01) && hits(0.01 - radius), "{wo}");
        assert!(!hits(radius + 0.01) && !hits(-0.01 - radius), "{wo}");
    }
}

#[test]
fn light_goes_on_in_the_classes_that_cycles_counts() {
    let wo = views()[1];
    let mut random = Random(2);
    let mut classes = |hair: Hair| {
        let surface = surface(hair, wo);
        let mut lobes = [0_i32; 8];
        let mut lights = [0_i32; 8];
        for sample in (0..20_000).filter_map(|_| surface.sample(random.next3())) {
            lobes[sample.lobe as usize] += 1;
            lights[sample.light.lobe as usize] += 1;
        }
        (lobes, lights)
    };
    let [glossy, transmitted, lit] =
        [Lobe::Glossy, Lobe::Transmission, Lobe::RoughGlossy].map(|lobe| lobe as usize);
    let (lobes, lights) = classes(chiang(0.2, 0.3, wo));
    assert!(lobes[glossy] > 500 && lobes[transmitted] > 10_000, "{lobes:?}");
    assert_eq!(lobes[glossy] + lobes[transmitted], lights[lit]);
    let (lobes, lights) = classes(huang(&HUANG, wo));
    assert!(lobes[transmitted] == 0 && lobes[glossy] > 10_000 && lobes[glossy] == lights[lit]);
}

#[test]
fn directions_below_the_surface_are_scattered_to_and_guided_to() {
    let wo = views()[1];
    let surface = surface(chiang(0.2, 0.4, wo), wo);
    let mut random = Random(4);
    let samples = (0..1000).filter_map(|_| surface.sample(random.next3()));
    let below: Vec<_> = samples.filter(|sample| sample.wi.z < 0.0).collect();
    assert!(below.len() > 200);
    assert!(below.iter().all(|sample| !sample.lights_only && !sample.singular));
    for wi in [Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8), Vec3::X, Vec3::Z] {
        let told = surface.sample_towards(wi, 0.7).expect("hair scatters everywhere");
        let (value, pdf) = surface.eval(wi);
        assert!((told.weight - value / pdf).abs().max_element() < 1e-4 && !told.lights_only, "{wi}");
    }
    assert!(surface.is_guided());
}

#[test]
fn pigments_absorb_as_the_papers_say() {
    assert_eq!(absorption_of_color(Vec3::ONE, 0.3), Vec3::ZERO);
    assert_eq!(absorption_of_melanin(0.0, 0.7), Vec3::ZERO);
    // An amount of 1 - 1/e is a concentration of 1.
    let amount = 1.0 - (-1.0f32).exp();
    let brown = absorption_of_melanin(amount, 0.0);
    assert!((brown - Vec3::new(0.506, 0.841, 1.653)).abs().max_element() < 1e-5);
    let red = absorption_of_melanin(amount, 1.0);
    assert!((red - Vec3::new(0.343, 0.733, 1.924)).abs().max_element() < 1e-5);
    // (ln 0.5 / 5.969)^2 where the polynomial is its constant.
    let half = absorption_of_color(Vec3::splat(0.5), 0.0);
    assert!((half.x - (0.5f32.ln() / 5.969).powi(2)).abs() < 1e-6);
    assert!(absorption_of_color(Vec3::ZERO, 0.3).is_finite());
}

#[test]
fn whatever_is_set_gives_numbers() {
    let mut random = Random(8);
    let wos = [Vec3::Z, ALONG, -ALONG, Vec3::new(0.6, 0.8, 1e-4).normalize(), ALONG.cross(Vec3::Z)];
    for wo in wos {
        for offset in [-1.0, 0.0, 1.0] {
            for (roughness, ior, absorption) in [
                (0.0, 1.0, 0.0),
                (1.0, 0.0, 1e6),
                (0.3, 0.6, -1.0),
                (2.0, 40.0, f32::INFINITY),
                (-1.0, -2.0, 0.1),
            ] {
                let absorption = Vec3::splat(absorption);
                let chiang =
                    ChiangParameters { roughness, radial_roughness: roughness, ior, absorption, ..CHIANG };
                let mut hairs = vec![
                    Hair::Chiang(Chiang::new(fibre_at(offset, wo), &chiang, wo)),
                    Hair::Lobe(HairLobe::new(
                        fibre_at(offset, wo),
                        Vec3::Z,
                        HairSide::Reflection,
                        ior,
                        (roughness, roughness),
                        wo,
                    )),
                ];
                for aspect_ratio in [0.0, 1.0, 3.0, -1.0] {
                    for coverage in [0.0, 0.1, 5.0] {
                        let huang =
                            HuangParameters { roughness, aspect_ratio, ior, absorption, coverage, ..HUANG };
                        let hair = Huang::new(fibre_at(offset, wo), &huang, wo);
                        hairs.extend(hair.map(Hair::Huang));
                    }
                }
                for hair in hairs {
                    let surface = surface(hair, wo);
                    assert!(surface.albedo().is_finite(), "{hair:?}");
                    for _ in 0..20 {
                        let sample = surface.sample(random.next3());
                        assert!(sample.is_none_or(|sample| sample.wi.is_normalized()), "{hair:?}");
                    }
                    for wi in wos {
                        let (value, pdf) = surface.eval(wi);
                        assert!(value.is_finite() && pdf.is_finite(), "{hair:?} to {wi}: {value} {pdf}");
                    }
                }
            }
        }
    }
}
