use crate::bake::features::pixel_features;
use crate::device::compute::Compute;
use crate::device::connections::Connections;
use crate::error::SessionError;
use crate::files::proxies::{MeanQuality, Measured};
use crate::progress::{Monitor, Stage};
use crate::relight::denoise::Denoise;
use crate::relight::relighter::Relighter;
use crate::train::targets::{DumpTargets, GpuTargets};
use glam::Vec3;
use rayon::prelude::*;
use relume_gather::{DenoiseQuality, Gather, SampleSplit};
use relume_image::metrics::{self, Quality, quality};
use relume_image::{BitDepth, Image, ViewTransform, write_png};
use relume_proxy::{LightParams, Proxy, Rng, TargetSource, random_light};
use serde::Serialize;
use std::path::Path;

/// Stream of the random numbers that choose the lights; training uses others.
const STREAM: u64 = 0x6d65_6173;

/// Lights that one pass over an independent bake gathers.
const LIGHTS_A_PASS: usize = 25;

/// Lights whose pictures are held at the same time at the end of a training.
const LIGHTS_MEASURED_AT_ONCE: usize = 4;

/// Lights of which [`evaluate`] writes a picture.
const PICTURES: usize = 6;

/// Mean errors of proxies and of gathering, on the same lights, against the denoised gather of an independent bake.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Lights.
    pub lights: usize,
    /// One for each proxy.
    pub proxies: Vec<MeanQuality>,
    /// Gathering from the bake that was to be compared.
    pub gather: Option<MeanQuality>,
    /// Errors of the denoised gather, without those that the denoiser makes in both pictures alike.
    pub gather_denoised: Option<MeanQuality>,
    /// The reference before it was denoised, which tells how noisy it is.
    pub reference_noise: MeanQuality,
}

/// Compares a proxy with gathering on lights that it was not trained on. The reference is gathered and denoised from the
/// second of `halves`, what is compared from the first, so that neither knows the other's noise.
pub(crate) fn measure(
    proxy: &Proxy,
    gather: &Gather,
    halves: (SampleSplit, SampleSplit),
    held_out: &DumpTargets,
    count: usize,
    seed: u64,
    monitor: &Monitor,
) -> Result<Measured, SessionError> {
    let compared = held_out.of_split(halves.0);
    let comparison = PictureComparison {
        proxies: std::slice::from_ref(proxy),
        reference: held_out,
        compared: Some(&compared),
    };
    let found = comparison.run((count, LIGHTS_MEASURED_AT_ONCE), seed, None, monitor)?;
    Ok(Measured {
        lights: found.lights,
        samples: halves.0.tile_samples(gather.dump(), 0),
        seconds: None,
        proxy: found.proxies[0],
        gather: found.gather.unwrap_or(found.reference_noise),
        gather_denoised: found.gather_denoised.unwrap_or(found.reference_noise),
    })
}

/// Measures proxies of one kind and range on lights that no training sees. The reference is the denoised gather of an
/// independent bake of the same camera, with many more samples. The lights depend on the reference, the range and
/// `seed` alone. With `compared`, the gather of that bake is measured as well. With `pictures`, PNGs of some lights are
/// written there: reference, gather, denoised gather, proxies. A lost GPU is opened again, once; if it fails again, the
/// CPU takes over where it may.
///
/// # Errors
/// If a bake cannot be read, its size is not the proxies', or the proxies differ in kind or range.
pub fn evaluate(
    proxies: &[Proxy],
    reference: &Relighter,
    compared: Option<&Relighter>,
    (lights, seed): (usize, u64),
    pictures: Option<&Path>,
    compute: &Compute,
    monitor: &Monitor,
) -> Result<Evaluation, SessionError> {
    compute.attempt(
        monitor,
        || "",
        |compute| evaluate_on(compute, proxies, reference, compared, (lights, seed), pictures, monitor),
    )
}

/// [`evaluate`] without another try.
fn evaluate_on(
    compute: &Compute,
    proxies: &[Proxy],
    reference: &Relighter,
    compared: Option<&Relighter>,
    lights: (usize, u64),
    pictures: Option<&Path>,
    monitor: &Monitor,
) -> Result<Evaluation, SessionError> {
    let Some(first) = proxies.first() else {
        return Err(SessionError::Settings("there is no proxy to evaluate; name at least one".into()));
    };
    for proxy in proxies {
        if (proxy.info().kind, proxy.info().size) != (first.info().kind, first.info().size) {
            let reason = "the proxies are of different kinds or light sizes; evaluate them one by one";
            return Err(SessionError::Settings(reason.into()));
        }
        check_size(proxy, reference)?;
    }
    if let Some(folder) = pictures {
        std::fs::create_dir_all(folder).map_err(SessionError::io("create the folder", folder))?;
    }
    let bounds = pixel_features(reference.aovs(), reference.camera()).visible_bounds();
    if let Some(bake) = compared {
        check_size(first, bake)?;
    }
    let reference = Measurable::new(reference, compute)?;
    let compared = compared.map(|bake| Measurable::new(bake, compute)).transpose()?;
    let (reference, compared) =
        (reference.targets(bounds), compared.as_ref().map(|bake| bake.targets(bounds)));
    let comparison = PictureComparison { proxies, reference: &reference, compared: compared.as_ref() };
    comparison.run((lights.0, LIGHTS_A_PASS), lights.1, pictures, monitor)
}

/// A bake that pictures are made from to be measured.
struct Measurable<'a> {
    gather: &'a Gather,
    denoise: Denoise,
    on_gpu: Option<GpuTargets>,
    /// Connections in the scene, where that is at hand.
    connections: Option<&'a Connections>,
}

impl<'a> Measurable<'a> {
    fn new(bake: &'a Relighter, compute: &Compute) -> Result<Self, SessionError> {
        let gather = bake_of(bake)?;
        let denoise = Denoise::new(bake.aovs(), compute.gpu.as_deref());
        let on_gpu = compute.gpu.as_ref().map(|gpu| GpuTargets::new(gpu, gather)).transpose()?;
        Ok(Self { gather, denoise, on_gpu, connections: bake.connections() })
    }

    fn targets(&self, bounds: (Vec3, Vec3)) -> DumpTargets<'_> {
        let connections = self.connections.map(|connections| (connections, usize::MAX));
        DumpTargets::new(self.gather, SampleSplit::All, bounds, &self.denoise)
            .on(self.on_gpu.as_ref())
            .with_connections(connections)
    }
}

fn bake_of(relighter: &Relighter) -> Result<&Gather, SessionError> {
    relighter.gather().ok_or_else(|| {
        SessionError::Settings(
            "a folder to measure against holds proxies but no bake; give one with a bake".into(),
        )
    })
}

fn check_size(proxy: &Proxy, bake: &Relighter) -> Result<(), SessionError> {
    let ([width, height], camera) = (proxy.info().image, bake.camera());
    if [width, height] == [camera.width, camera.height] {
        return Ok(());
    }
    let reason = format!(
        "the proxy is for {width} x {height} pixels, the bake to measure against has {} x {}",
        camera.width, camera.height
    );
    Err(SessionError::Settings(reason))
}

/// Pictures that are compared.
struct PictureComparison<'a> {
    /// Proxies of one kind and range.
    proxies: &'a [Proxy],
    reference: &'a DumpTargets<'a>,
    compared: Option<&'a DumpTargets<'a>>,
}

impl PictureComparison<'_> {
    fn run(
        &self,
        (count, at_once): (usize, usize),
        seed: u64,
        pictures: Option<&Path>,
        monitor: &Monitor,
    ) -> Result<Evaluation, SessionError> {
        let stage = monitor.stage(Stage::Measure, 0, count as u64);
        let mut sums = QualitySums::default();
        let numbers: Vec<u64> = (0..count as u64).collect();
        for some in numbers.chunks(at_once) {
            if monitor.cancelled() {
                return Err(SessionError::Cancelled);
            }
            let light = |i: &u64| {
                held_out_light(&self.proxies[0], self.reference, &mut Rng::stream(seed, STREAM, *i))
            };
            let lights: Vec<LightParams> = some.iter().filter_map(light).collect();
            self.lights(&lights, some[0] as usize, pictures, &mut sums)?;
            stage.advance(some.len() as u64, "");
        }
        let mut means = sums.lists.iter().map(|list| mean(list));
        let proxies = means.by_ref().take(self.proxies.len()).collect();
        let reference_noise = means.next().unwrap_or(mean(&[]));
        let (gather, gather_denoised) = (means.next(), means.next());
        Ok(Evaluation { lights: sums.lights, proxies, gather, gather_denoised, reference_noise })
    }

    /// Adds the errors for some lights, the first of which has this number, to `sums`. Those are of proxies, noisy
    /// reference, gather, and denoised gather.
    fn lights(
        &self,
        lights: &[LightParams],
        number: usize,
        pictures: Option<&Path>,
        sums: &mut QualitySums,
    ) -> Result<(), SessionError> {
        let shapes: Vec<_> = lights.iter().map(LightParams::shape).collect();
        let noisy = self.reference.images(&shapes, false)?;
        let references = denoised(self.reference, &noisy)?;
        let mut rows = Vec::new();
        for proxy in self.proxies {
            let images: Result<Vec<Image>, _> = lights.iter().map(|light| proxy.unit_image(light)).collect();
            rows.push(images?);
        }
        rows.push(noisy);
        if let Some(compared) = self.compared {
            let gathered = compared.images(&shapes, false)?;
            let denoised = denoised(compared, &gathered)?;
            rows.extend([gathered, denoised]);
        }
        sums.add(&rows, &references);
        let Some(folder) = pictures else { return Ok(()) };
        for i in 0..PICTURES.saturating_sub(number).min(lights.len()) {
            let (proxies, gathers) = rows.split_at(self.proxies.len());
            let shown = [&references].into_iter().chain(&gathers[1..]).chain(proxies).map(|row| &row[i]);
            let path = folder.join(format!("light_{:02}.png", number + i));
            write_png(
                &path,
                &side_by_side(shown, &references[i]),
                &ViewTransform::default(),
                BitDepth::Eight,
            )?;
        }
        Ok(())
    }
}

fn denoised(source: &DumpTargets, images: &[Image]) -> Result<Vec<Image>, SessionError> {
    let mut images = images.to_vec();
    source.denoise().images(&mut images, DenoiseQuality::High)?;
    Ok(images)
}

/// The errors of each kind of picture, light by light.
#[derive(Default)]
struct QualitySums {
    lists: Vec<Vec<Quality>>,
    lights: usize,
}

impl QualitySums {
    fn add(&mut self, rows: &[Vec<Image>], references: &[Image]) {
        self.lists.resize(rows.len(), Vec::new());
        self.lights += references.len();
        for (list, row) in self.lists.iter_mut().zip(rows) {
            list.par_extend(
                row.par_iter().zip(references).map(|(image, reference)| quality(image, reference)),
            );
        }
    }
}

/// Pictures in one row, tonemapped as for the metrics.
fn side_by_side<'a>(images: impl Iterator<Item = &'a Image>, reference: &Image) -> Image {
    let exposure = metrics::exposure(reference);
    let toned: Vec<Image> = images.map(|image| metrics::tonemap(image, exposure)).collect();
    let row_len = reference.width * 3;
    let mut sheet = Image::new(reference.width * toned.len(), reference.height, 3);
    for (y, row) in sheet.data.chunks_exact_mut(row_len * toned.len()).enumerate() {
        for (to, image) in row.chunks_exact_mut(row_len).zip(&toned) {
            to.copy_from_slice(&image.data[y * row_len..(y + 1) * row_len]);
        }
    }
    sheet
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
