//! Claims that every closure must keep: its sampler follows its density, its weight is value over density, and no
//! energy appears.

use std::f32::consts::PI;

use glam::Vec3;
use relume_dump::Lobe;
use relume_scene::MultipleScattering;

use super::*;
use crate::shading::{RayInfo, SurfacePoint};

/// SplitMix64, to have the same samples in every run.
pub(super) struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = self.0;
        word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((word ^ (word >> 31)) >> 40) as f32 / 16_777_216.0
    }

    pub fn next3(&mut self) -> [f32; 3] {
        [self.next(), self.next(), self.next()]
    }
}

pub(super) fn facing(wo: Vec3) -> Surface {
    let point = SurfacePoint {
        position: Vec3::ZERO,
        geometric_normal: Vec3::Z,
        shading_normal: Vec3::Z,
        wo,
        backfacing: false,
        instance: 0,
        geometry: 0.into(),
        primitive: 0,
        barycentrics: [0.3, 0.3],
        ray_length: 1.0,
        footprint: 1e-3,
        strand: None,
        time: relume_scene::STILL,
        ray: RayInfo::default(),
    };
    let mut surface = Surface::default();
    surface.reset(&point);
    surface
}

pub(super) fn microfacet(
    shape: SlopeDistribution,
    interface: Interface,
    alpha: (f32, f32),
    ior: f32,
    fresnel: Fresnel,
) -> Scatter {
    Scatter::Microfacet(Microfacet {
        distribution: MicrofacetDistribution { shape, alpha_x: alpha.0, alpha_y: alpha.1 },
        interface,
        ior,
        fresnel,
        frame: ShadingFrame::from_tangent(Vec3::Z, Vec3::new(0.8, 0.6, 0.0)),
        energy_scale: 1.0,
    })
}

type Build = fn(Vec3) -> Scatter;

/// One of each model that has a density, by name.
fn models() -> Vec<(&'static str, Build)> {
    use Interface::{Glass, Reflection, Refraction};
    use SlopeDistribution::{Beckmann, Ggx};
    vec![
        ("diffuse", |_| Scatter::Diffuse),
        ("oren-nayar", |wo| {
            Scatter::OrenNayar(OrenNayar::new(Vec3::Z, 0.8, Vec3::ONE, MultipleScattering::Full, wo))
        }),
        ("translucent", |_| Scatter::Translucent),
        ("rough translucent", |wo| {
            Scatter::RoughTranslucent(OrenNayar::new(Vec3::Z, 0.8, Vec3::ONE, MultipleScattering::Full, wo))
        }),
        ("through a sheet", |_| {
            let Scatter::Microfacet(model) = microfacet(Ggx, Reflection, (0.4, 0.4), 1.0, Fresnel::None)
            else {
                unreachable!()
            };
            Scatter::ThroughSheet(model)
        }),
        ("sheen smooth", |wo| Scatter::Sheen(Sheen::new(Vec3::Z, 0.3, wo).unwrap().0)),
        ("sheen rough", |wo| Scatter::Sheen(Sheen::new(Vec3::Z, 0.9, wo).unwrap().0)),
        ("velvet", |_| Scatter::Velvet(Velvet::new(Vec3::Z, 0.5))),
        ("toon", |_| Scatter::Toon(Toon::diffuse(Vec3::Z, 0.4, 0.3).unwrap())),
        ("toon to the horizon", |_| Scatter::Toon(Toon::diffuse(Vec3::Z, 0.8, 0.5).unwrap())),
        ("ashikhmin", |_| {
            let frame = ShadingFrame::from_tangent(Vec3::Z, Vec3::X);
            Scatter::AshikhminShirley(AshikhminShirley::new(frame, 0.3, 0.3))
        }),
        ("ashikhmin anisotropic", |_| {
            let frame = ShadingFrame::from_tangent(Vec3::Z, Vec3::X);
            Scatter::AshikhminShirley(AshikhminShirley::new(frame, 0.5, 0.2))
        }),
        ("ggx", |_| microfacet(Ggx, Reflection, (0.3, 0.3), 1.0, Fresnel::None)),
        ("ggx anisotropic", |_| microfacet(Ggx, Reflection, (0.6, 0.2), 1.0, Fresnel::None)),
        ("ggx rough", |_| microfacet(Ggx, Reflection, (1.0, 1.0), 1.0, Fresnel::None)),
        ("beckmann", |_| microfacet(Beckmann, Reflection, (0.4, 0.4), 1.0, Fresnel::None)),
        ("beckmann anisotropic", |_| microfacet(Beckmann, Reflection, (0.6, 0.3), 1.0, Fresnel::None)),
        ("metal", |_| {
            let f82 = F82::new(Vec3::new(0.9, 0.6, 0.2), Vec3::splat(0.8));
            microfacet(Ggx, Reflection, (0.3, 0.3), 1.0, Fresnel::Metal(f82, None))
        }),
        ("conductor", |_| {
            let copper = Conductor { ior: Vec3::new(0.2, 0.92, 1.1), extinction: Vec3::new(3.9, 2.4, 2.2) };
            microfacet(Ggx, Reflection, (0.3, 0.3), 1.0, Fresnel::Conductor(copper, None))
        }),
        ("refraction", |_| microfacet(Ggx, Refraction, (0.3, 0.3), 1.4, Fresnel::None)),
        ("refraction from inside", |_| microfacet(Ggx, Refraction, (0.3, 0.3), 1.0 / 1.4, Fresnel::None)),
        ("glass", |_| microfacet(Ggx, Glass, (0.4, 0.4), 1.5, Fresnel::Dielectric)),
        ("glass from inside", |_| microfacet(Ggx, Glass, (0.4, 0.4), 1.0 / 1.5, Fresnel::Dielectric)),
        ("beckmann glass", |_| microfacet(Beckmann, Glass, (0.4, 0.4), 1.5, Fresnel::Dielectric)),
        ("chiang", |wo| Scatter::Hair(hair::tests::chiang(0.2, 0.3, wo))),
        ("chiang at the edge", |wo| Scatter::Hair(hair::tests::chiang(-0.95, 0.2, wo))),
        ("hair reflection", |wo| Scatter::Hair(hair::tests::lobe(HairSide::Reflection, wo))),
        ("hair transmission", |wo| Scatter::Hair(hair::tests::lobe(HairSide::Transmission, wo))),
        ("tinted glass", |_| {
            let fresnel = Fresnel::Tinted {
                f0: Vec3::new(0.08, 0.04, 0.02),
                reflection: Vec3::ONE,
                transmission: Vec3::new(0.9, 0.5, 0.1),
                film: None,
            };
            microfacet(Ggx, Glass, (0.5, 0.5), 1.5, fresnel)
        }),
        ("glass with a film", |_| {
            let fresnel = Fresnel::Tinted {
                f0: Vec3::splat(0.04),
                reflection: Vec3::ONE,
                transmission: Vec3::ONE,
                film: Film::new(420.0, 1.33, relume_scene::FilmModel::Tabulated),
            };
            microfacet(Ggx, Glass, (0.5, 0.3), 1.5, fresnel)
        }),
    ]
}

pub(super) fn views() -> [Vec3; 3] {
    [0.05f32, 0.8, 1.35].map(|theta| {
        let (sin, cos) = theta.sin_cos();
        Vec3::new(sin * 0.96, sin * 0.28, cos)
    })
}

fn surface_of(build: Build, wo: Vec3) -> Surface {
    let mut surface = facing(wo);
    assert!(surface.add(Vec3::ONE, Vec3::ONE, Vec3::Z, build(wo)));
    surface
}

const ROWS: usize = 24;
const COLUMNS: usize = 24;

fn cell_of(wi: Vec3) -> usize {
    let row = (wi.z.clamp(-1.0, 1.0).acos() / PI * ROWS as f32) as usize;
    let column = ((wi.y.atan2(wi.x) / PI + 1.0) * 0.5 * COLUMNS as f32) as usize;
    row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
}

/// Integrals of the density over cells of equal angles.
fn cell_probabilities(surface: &Surface) -> Vec<f64> {
    const SUB: usize = 24;
    let mut cells = vec![0.0; ROWS * COLUMNS];
    let step = 2.0 * std::f64::consts::PI.powi(2) / (ROWS * COLUMNS * SUB * SUB) as f64;
    for row in 0..ROWS * SUB {
        let (sin, cos) = (PI * (row as f32 + 0.5) / (ROWS * SUB) as f32).sin_cos();
        for column in 0..COLUMNS * SUB {
            let phi = PI * (2.0 * (column as f32 + 0.5) / (COLUMNS * SUB) as f32 - 1.0);
            let wi = Vec3::new(sin * phi.cos(), sin * phi.sin(), cos);
            cells[row / SUB * COLUMNS + column / SUB] += f64::from(surface.eval(wi).1 * sin) * step;
        }
    }
    cells
}

/// Deviation of a chi-squared statistic in standard deviations (Wilson and Hilferty's normal approximation), with
/// cells of small expectation pooled.
fn chi_squared_deviation(observed: &[f64], expected: &[f64]) -> f64 {
    let (mut statistic, mut cells) = (0.0, 0.0);
    let (mut pooled_observed, mut pooled_expected) = (0.0, 0.0);
    for (o, e) in observed.iter().zip(expected) {
        if *e < 10.0 {
            pooled_observed += o;
            pooled_expected += e;
        } else {
            statistic += (o - e) * (o - e) / e;
            cells += 1.0;
        }
    }
    if pooled_expected > 10.0 {
        statistic +=
            (pooled_observed - pooled_expected) * (pooled_observed - pooled_expected) / pooled_expected;
        cells += 1.0;
    } else {
        assert!(pooled_observed < 60.0, "{pooled_observed} samples where {pooled_expected} are expected");
    }
    if cells == 0.0 {
        return 0.0;
    }
    let spread = 2.0 / (9.0 * cells);
    ((statistic / cells).powf(1.0 / 3.0) - (1.0 - spread)) / spread.sqrt()
}

fn assert_sampler_follows_density(name: &str, surface: &Surface) {
    const SAMPLES: usize = 40_000;
    let probabilities = cell_probabilities(surface);
    let total: f64 = probabilities.iter().sum();
    assert!(total < 1.01, "{name}: density integrates to {total}");
    let mut random = Random(7);
    let mut observed = vec![0.0; ROWS * COLUMNS];
    for _ in 0..SAMPLES {
        if let Some(sample) = surface.sample(random.next3()) {
            observed[cell_of(sample.wi)] += 1.0;
        }
    }
    let expected: Vec<f64> = probabilities.iter().map(|p| p * SAMPLES as f64).collect();
    let deviation = chi_squared_deviation(&observed, &expected);
    assert!(deviation < 4.5, "{name}: chi-squared is {deviation} standard deviations off");
}

/// Models whose samples go where their values are. Those of the Hair BSDF's reflection also go elsewhere, unlit.
fn consistent_models() -> impl Iterator<Item = (&'static str, Build)> {
    models().into_iter().filter(|(name, _)| *name != "hair reflection")
}

#[test]
fn every_sampler_follows_its_density() {
    for (name, build) in consistent_models() {
        for wo in views() {
            assert_sampler_follows_density(&format!("{name} from {wo}"), &surface_of(build, wo));
        }
    }
}

#[test]
fn mixtures_follow_their_density() {
    for wo in views() {
        let mut surface = facing(wo);
        for (name, build) in models() {
            if ["diffuse", "ggx", "glass", "sheen rough", "translucent", "chiang"].contains(&name) {
                surface.add(Vec3::new(0.3, 0.2, 0.1), Vec3::ONE, Vec3::Z, build(wo));
            }
        }
        assert_sampler_follows_density(&format!("mixture from {wo}"), &surface);
    }
}

#[test]
fn defensive_sampling_changes_choices_and_not_the_mean() {
    let mixture = || {
        let mut surface = facing(views()[1]);
        let (gloss, albedo) =
            (microfacet(SlopeDistribution::Ggx, Interface::Reflection, (0.2, 0.2), 1.0, Fresnel::None), 0.02);
        surface.add(Vec3::splat(albedo), Vec3::ONE, Vec3::Z, gloss);
        surface.add(Vec3::splat(0.8), Vec3::ONE, Vec3::Z, Scatter::Diffuse);
        surface
    };
    let (plain, mut defensive) = (mixture(), mixture());
    defensive.sample_defensively();
    assert_sampler_follows_density("defensive", &defensive);
    assert!((furnace(&plain, 100_000).x - furnace(&defensive, 100_000).x).abs() < 5e-3);
    let mut random = Random(5);
    let glossy =
        (0..10_000).filter_map(|_| defensive.sample(random.next3())).filter(|s| s.lobe == Lobe::Glossy);
    assert!(glossy.count() > 900);
}

#[test]
fn weights_are_value_over_density() {
    for (name, build) in consistent_models() {
        for wo in views() {
            let surface = surface_of(build, wo);
            let mut random = Random(3);
            for sample in (0..500).filter_map(|_| surface.sample(random.next3())) {
                let (value, pdf) = surface.eval(sample.wi);
                let tolerance = 0.02 * pdf.max(0.05);
                assert!((pdf - sample.pdf).abs() < tolerance, "{name}: density {pdf} and {}", sample.pdf);
                let expected = value / pdf;
                assert!(
                    (expected - sample.weight).abs().max_element() < 0.02 * expected.max_element() + 1e-4,
                    "{name} from {wo} to {}: {expected} and {}",
                    sample.wi,
                    sample.weight
                );
                assert!((sample.wi.length() - 1.0).abs() < 1e-4);
            }
        }
    }
}

/// Mean weight of samples: what comes back out of a uniformly white surrounding.
fn furnace(surface: &Surface, samples: usize) -> Vec3 {
    let mut random = Random(11);
    (0..samples).filter_map(|_| surface.sample(random.next3())).map(|s| s.weight).sum::<Vec3>()
        / samples as f32
}

#[test]
fn no_closure_creates_energy() {
    for (name, build) in models() {
        for wo in views() {
            let returned = furnace(&surface_of(build, wo), 100_000).max_element();
            // Ashikhmin and Shirley's lobe is not normalised at grazing angles.
            assert!(returned < 1.01 || name.starts_with("ashikhmin"), "{name} from {wo}: {returned}");
        }
    }
}

#[test]
fn lossless_closures_return_all() {
    for wo in views() {
        for (name, build) in models() {
            let lossless =
                ["diffuse", "oren-nayar", "translucent", "rough translucent", "sheen smooth", "sheen rough"];
            if lossless.contains(&name) {
                let returned = furnace(&surface_of(build, wo), 100_000).x;
                assert!((returned - 1.0).abs() < 0.01, "{name} from {wo}: {returned}");
            }
        }
    }
}

#[test]
fn compensated_metal_returns_all() {
    for roughness in [0.05f32, 0.3, 0.6, 1.0] {
        for wo in views() {
            let alpha = roughness * roughness;
            let compensation = Compensation::reflection(roughness, wo.z, Vec3::ONE);
            let Scatter::Microfacet(mut model) =
                microfacet(SlopeDistribution::Ggx, Interface::Reflection, (alpha, alpha), 1.0, Fresnel::None)
            else {
                unreachable!()
            };
            model.energy_scale = compensation.scale;
            let mut surface = facing(wo);
            surface.add(compensation.darkening, Vec3::ONE, Vec3::Z, Scatter::Microfacet(model));
            let returned = furnace(&surface, 100_000).x;
            assert!((returned - 1.0).abs() < 0.02, "roughness {roughness} from {wo}: {returned}");
        }
    }
}

#[test]
fn compensated_glass_returns_all() {
    for roughness in [0.0f32, 0.2, 0.5, 1.0] {
        for ior in [1.5, 1.0 / 1.5, 1.1, 2.0] {
            for wo in views() {
                let alpha = roughness * roughness;
                let compensation = Compensation::glass(roughness, wo.z, ior, Vec3::ONE);
                let Scatter::Microfacet(mut model) = microfacet(
                    SlopeDistribution::Ggx,
                    Interface::Glass,
                    (alpha, alpha),
                    ior,
                    Fresnel::Dielectric,
                ) else {
                    unreachable!()
                };
                model.energy_scale = compensation.scale;
                let mut surface = facing(wo);
                surface.add(compensation.darkening, Vec3::ONE, Vec3::Z, Scatter::Microfacet(model));
                let returned = furnace(&surface, 100_000).x;
                // The coarse table that Cycles has, and so have we, errs by some percent near the critical angle.
                assert!((returned - 1.0).abs() < 0.05, "{roughness} {ior} from {wo}: {returned}");
            }
        }
    }
}

#[test]
fn reflection_is_reciprocal() {
    let pairs = [(0, 1), (1, 2), (0, 2)];
    for (name, build) in models() {
        if ["diffuse", "oren-nayar", "ashikhmin", "ggx", "ggx anisotropic", "beckmann", "metal"]
            .contains(&name)
        {
            for (i, j) in pairs {
                let (a, b) = (views()[i], views()[j] * Vec3::new(-1.0, 1.0, 1.0));
                let forward = surface_of(build, a).eval(b).0 / b.z;
                let backward = surface_of(build, b).eval(a).0 / a.z;
                assert!(
                    (forward - backward).abs().max_element() < 1e-3 * forward.max_element() + 1e-5,
                    "{name}: {forward} and {backward}"
                );
            }
        }
    }
}

#[test]
fn refraction_is_reciprocal_up_to_the_squared_index() {
    let wo = Vec3::new(0.5, 0.1, 0.8).normalize();
    let wi = Vec3::new(-0.3, 0.05, -0.9).normalize();
    let value = |ior: f32, from: Vec3, to: Vec3| {
        let flip = if from.z < 0.0 { Vec3::new(1.0, 1.0, -1.0) } else { Vec3::ONE };
        let (from, to) = (from * flip, to * flip);
        let glass =
            microfacet(SlopeDistribution::Ggx, Interface::Glass, (0.5, 0.5), ior, Fresnel::Dielectric);
        let mut surface = facing(from);
        surface.add(Vec3::ONE, Vec3::ONE, Vec3::Z, glass);
        surface.eval(to).0.x / to.z.abs()
    };
    let (into, out) = (value(1.5, wo, wi), value(1.0 / 1.5, wi, wo));
    assert!(into > 0.0);
    assert!((into / (1.5 * 1.5) - out).abs() < 1e-3 * out, "{into} {out}");
}

#[test]
fn mirrors_and_clear_glass_are_singular() {
    let wo = views()[1];
    let mut surface = facing(wo);
    let mirror = microfacet(SlopeDistribution::Ggx, Interface::Reflection, (0.0, 0.0), 1.0, Fresnel::None);
    surface.add(Vec3::new(0.9, 0.5, 0.1), Vec3::ONE, Vec3::Z, mirror);
    let sample = surface.sample([0.2, 0.3, 0.4]).expect("a mirror reflects");
    assert!(sample.singular && surface.is_specular());
    assert!((sample.wi - Vec3::new(-wo.x, -wo.y, wo.z)).length() < 1e-5);
    assert!((sample.weight - Vec3::new(0.9, 0.5, 0.1)).length() < 1e-5);
    assert_eq!(surface.eval(sample.wi), (Vec3::ZERO, 0.0));
    surface.blur(0.3);
    assert!(!surface.sample([0.2, 0.3, 0.4]).expect("a mirror reflects").singular);
}

#[test]
fn alpha_passes_and_stops_in_proportion() {
    let mut surface = facing(views()[1]);
    surface.add_transparent(Vec3::splat(0.25));
    surface.add(Vec3::splat(0.75), Vec3::ONE, Vec3::Z, Scatter::Diffuse);
    let mut random = Random(1);
    let samples: Vec<_> = (0..20_000).filter_map(|_| surface.sample(random.next3())).collect();
    let passed = samples.iter().filter(|sample| sample.transparent).count();
    assert!((passed as f32 / 20_000.0 - 0.25).abs() < 0.01);
    assert!(samples.iter().all(|sample| (sample.weight - Vec3::ONE).length() < 1e-3));
    assert_eq!(surface.transparency(), Vec3::splat(0.25));
}

#[test]
fn weights_that_are_not_numbers_are_dropped() {
    let mut surface = facing(Vec3::Z);
    surface.add(Vec3::new(f32::NAN, 1.0, 1.0), Vec3::ONE, Vec3::Z, Scatter::Diffuse);
    surface.add(Vec3::splat(f32::INFINITY), Vec3::ONE, Vec3::Z, Scatter::Diffuse);
    surface.add_transparent(Vec3::splat(f32::NAN));
    let sample = surface.sample([0.5; 3]);
    assert!(sample.is_none_or(|sample| sample.weight.is_finite()));
}

#[test]
fn a_direction_is_told_as_sampling_tells_it() {
    let mut random = Random(11);
    let wo = Vec3::new(0.3, -0.4, 0.8).normalize();
    for (name, build) in consistent_models() {
        let mut surface = facing(wo);
        surface.add(Vec3::splat(0.3), Vec3::ONE, Vec3::Z, Scatter::Diffuse);
        surface.add(Vec3::new(0.6, 0.5, 0.4), Vec3::ONE, Vec3::Z, build(wo));
        let mut by_class = [[0_i32; 8]; 2];
        for _ in 0..20_000 {
            let Some(sampled) = surface.sample(random.next3()) else { continue };
            let told = surface.sample_towards(sampled.wi, random.next());
            // Another closure may not reach there.
            let Some(told) = told else { continue };
            assert!((told.pdf / sampled.pdf - 1.0).abs() < 1e-3, "{name}: {} for {}", told.pdf, sampled.pdf);
            let apart = (told.weight - sampled.weight).abs().max_element();
            assert!(apart < 1e-3 * sampled.weight.max_element(), "{name}: {apart}");
            by_class[0][sampled.lobe as usize] += 1;
            by_class[1][told.lobe as usize] += 1;
        }
        for (sampled, told) in by_class[0].iter().zip(by_class[1]) {
            // Five standard deviations of the difference.
            assert!((sampled - told).pow(2) <= 50 * (sampled + told), "{name}: {by_class:?}");
        }
    }
}
