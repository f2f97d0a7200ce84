use crate::denoise::Denoise;
use crate::progress::{Monitor, Stage};
use crate::proxies::{MeanQuality, Measured};
use crate::targets::DumpTargets;
use crate::{Relighter, SessionError, pixel_features};
use relume_gather::{DenoiseQuality, Gather, Half};
use relume_image::metrics::{Quality, quality};
use relume_proxy::{LightParams, Proxy, Rng, TargetSource, random_light};

/// Stream of the random numbers that choose the lights; training uses others.
const STREAM: u64 = 0x6d65_6173;

/// Lights that one pass over a reference gathers.
const LIGHTS_A_PASS: usize = 25;

/// Lights whose pictures, four each, are held at the same time when a proxy is compared with gathering.
const LIGHTS_MEASURED_AT_ONCE: usize = 4;

/// Compares a proxy with gathering on lights that it was not trained on. The reference is gathered and denoised from the
/// second of `halves`, what is compared from the first, so that neither knows the other's noise.
pub(crate) fn measure(
    proxy: &Proxy,
    gather: &Gather,
    halves: (Half, Half),
    held_out: &DumpTargets,
    count: usize,
    seed: u64,
    monitor: &Monitor,
) -> Result<Measured, SessionError> {
    let stage = monitor.stage(Stage::Measure, 0, count as u64);
    let compared = DumpTargets::new(gather, halves.0, held_out.bounds(), held_out.denoise());
    let (mut by_proxy, mut by_gather, mut by_denoised) = (Vec::new(), Vec::new(), Vec::new());
    for some in (0..count as u64).collect::<Vec<_>>().chunks(LIGHTS_MEASURED_AT_ONCE) {
        if monitor.cancelled() {
            return Err(SessionError::Cancelled);
        }
        let light = |i: &u64| held_out_light(proxy, held_out, &mut Rng::stream(seed, STREAM, *i));
        let lights: Vec<LightParams> = some.iter().filter_map(light).collect();
        let shapes: Vec<_> = lights.iter().map(LightParams::shape).collect();
        let (references, gathered) = (held_out.images(&shapes, true)?, compared.images(&shapes, false)?);
        let mut denoised = gathered.clone();
        held_out.denoise().images(&mut denoised, DenoiseQuality::High)?;
        for (i, light) in lights.iter().enumerate() {
            by_proxy.push(quality(&proxy.unit_image(light)?, &references[i]));
            by_gather.push(quality(&gathered[i], &references[i]));
            by_denoised.push(quality(&denoised[i], &references[i]));
        }
        stage.advance(some.len() as u64, "");
    }
    Ok(Measured {
        lights: by_proxy.len(),
        samples: halves.0.tile_samples(gather.dump(), 0),
        proxy: mean(&by_proxy),
        gather: mean(&by_gather),
        gather_denoised: mean(&by_denoised),
    })
}

/// Mean errors of a proxy against gathers of an independent bake of the same camera, which should have many more samples,
/// on lights that no training sees. The lights depend on the reference, the proxy's range and `seed` alone.
///
/// # Errors
/// If the bake cannot be read or its size is not the proxy's.
pub fn evaluate(
    proxy: &Proxy,
    reference: &Relighter,
    lights: usize,
    seed: u64,
    monitor: &Monitor,
) -> Result<MeanQuality, SessionError> {
    let gather = reference.gather().ok_or_else(|| {
        SessionError::Settings("the reference is a folder of proxies; give one with a bake".into())
    })?;
    let camera = reference.camera();
    if proxy.info().image != [camera.width, camera.height] {
        let [width, height] = proxy.info().image;
        let reason = format!(
            "the proxy is for {width} x {height} pixels, the reference has {} x {}",
            camera.width, camera.height
        );
        return Err(SessionError::Settings(reason));
    }
    let denoise = Denoise::new(reference.aovs());
    let bounds = pixel_features(reference.aovs(), camera).visible_bounds();
    let targets = DumpTargets::new(gather, Half::All, bounds, &denoise);
    let stage = monitor.stage(Stage::Measure, 0, lights as u64);
    let mut scores = Vec::new();
    let all: Vec<u64> = (0..lights as u64).collect();
    for some in all.chunks(LIGHTS_A_PASS) {
        if monitor.cancelled() {
            return Err(SessionError::Cancelled);
        }
        let params: Vec<LightParams> = some
            .iter()
            .filter_map(|i| held_out_light(proxy, &targets, &mut Rng::stream(seed, STREAM, *i)))
            .collect();
        let shapes: Vec<_> = params.iter().map(LightParams::shape).collect();
        for (light, expected) in params.iter().zip(targets.images(&shapes, false)?) {
            scores.push(quality(&proxy.unit_image(light)?, &expected));
        }
        stage.advance(some.len() as u64, "");
    }
    Ok(mean(&scores))
}

/// A light at a random point of a random pixel's paths, of a random size that was trained.
fn held_out_light(proxy: &Proxy, targets: &DumpTargets, rng: &mut Rng) -> Option<LightParams> {
    let info = proxy.info();
    let pixels = (info.image[0] * info.image[1]) as u32;
    let center = (0..64).find_map(|_| targets.segment_point(rng.below(pixels), rng))?;
    Some(random_light(info.kind, center, info.size, rng))
}

fn mean(list: &[Quality]) -> MeanQuality {
    let count = list.len().max(1) as f64;
    let sum = |f: fn(&Quality) -> f64| list.iter().map(f).sum::<f64>() / count;
    // Equal pictures have an infinite PSNR, which no mean survives.
    MeanQuality {
        psnr: sum(|q| q.psnr.min(100.0)),
        smape: sum(|q| q.smape),
        ssim: sum(|q| q.ssim),
        flip: sum(|q| q.flip),
    }
}
