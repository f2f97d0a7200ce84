//! Error of the pictures of lights by crossings and by connection, on lights of several sizes, against an independent bake
//! whose paths are guided towards them.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::Parser;
use glam::Vec3;
use relume_bench::rays_per_second;
use relume_dump::{ByConnectedLobe, Dump, End, Lobe, MemoryWriter, Pass};
use relume_image::metrics::{Quality, quality};
use relume_image::{BitDepth, Image, ViewTransform, write_png};
use relume_proxy::Rng;
use relume_scene::{Light, LightShape, Scene};
use relume_session::trace::bvh::{Ray, RayKind};
use relume_session::trace::{
    ConnectScratch, Control, LightCenter, PathScratch, ShadowTarget, TraceSettings, Tracer, UnpackedVertex,
    VertexLimits,
};
use relume_session::{Method, Monitor, RelightOptions, Relighter, SceneFile};
use serde::Serialize;

/// Compares the estimators of a light's picture.
#[derive(Parser, Debug)]
#[command(name = "relume-estimators", version)]
struct Args {
    /// Scene file.
    scene: PathBuf,
    /// JSON file to write.
    #[arg(long, short)]
    out: PathBuf,
    /// Radii of lights by half of the diagonal of what the paths reach.
    #[arg(long, value_delimiter = ',', default_values_t = [0.003, 0.01, 0.03, 0.1])]
    sizes: Vec<f32>,
    /// Lights of each size.
    #[arg(long, default_value_t = 2)]
    lights: usize,
    /// Paths per pixel.
    #[arg(long, value_delimiter = ',', default_values_t = [16, 64, 256, 512])]
    samples: Vec<u32>,
    /// Paths per pixel of the reference.
    #[arg(long, default_value_t = 1024)]
    reference: u32,
    /// Folder for pictures of the first light of each size.
    #[arg(long)]
    pictures: Option<PathBuf>,
    /// Seed of the lights.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Measures the speed of shadow rays alone.
    #[arg(long)]
    shadow_rays: bool,
}

/// Speed of the shadow rays to a small sphere on one thread.
#[derive(Serialize)]
struct ShadowRays {
    scene: String,
    /// Vertices that the light is connected to, a second.
    shadow_rays_per_second: f64,
    /// Speed of the same rays through the trees alone.
    bare_rays_per_second: f64,
}

/// Errors of one light's picture.
#[derive(Serialize)]
struct Measured {
    scene: String,
    width: usize,
    light_type: &'static str,
    light_size: f32,
    estimator: &'static str,
    denoised: bool,
    samples: u32,
    psnr: f64,
    smape: f64,
    ssim: f64,
    flip: f64,
    /// Mean of the picture over that of the reference.
    mean: f64,
    /// PSNR of two halves of the reference, denoised: how much of the error may be its own.
    reference_psnr: f64,
    seconds: f64,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let file = SceneFile::read(&args.scene)?;
    let scene = Arc::new(file.scene);
    let name = args.scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if args.shadow_rays {
        let measured = shadow_rays(&scene, name, args.seed)?;
        println!("{}", serde_json::to_string(&measured)?);
        return std::fs::write(&args.out, serde_json::to_string(&[measured])?).context("write the records");
    }
    let most = args.samples.iter().copied().max().unwrap_or(1);
    let dump = traced(&scene, most, 1, Vec::new())?;
    let mut records = Vec::new();
    for size in &args.sizes {
        for number in 0..args.lights {
            let light = random_light(&dump, *size, args.seed + number as u64);
            let elsewhere = random_light(&dump, *size, args.seed + 1000);
            let reference = Reference::new(&scene, &light, args.reference)?;
            for samples in &args.samples {
                for estimator in ["crossings", "connection"] {
                    let mut relighter =
                        Relighter::from_dump(first_passes(&dump, *samples), Path::new("/nonexistent"))?;
                    if estimator == "connection" {
                        relighter.connect(Arc::clone(&scene))?;
                    }
                    // Vertices are traced once for all lights.
                    unit_image(&relighter, &elsewhere, false)?;
                    let start = Instant::now();
                    let raw = unit_image(&relighter, &light, false)?;
                    let seconds = start.elapsed().as_secs_f64();
                    let clean = unit_image(&relighter, &light, true)?;
                    for (denoised, image) in [(false, &raw), (true, &clean)] {
                        let Quality { psnr, smape, ssim, flip } = quality(image, &reference.clean);
                        let record = Measured {
                            scene: name.clone(),
                            width: image.width,
                            light_type: "sphere",
                            light_size: *size,
                            estimator,
                            denoised,
                            samples: *samples,
                            psnr,
                            smape,
                            ssim,
                            flip,
                            mean: mean(image) / mean(&reference.clean),
                            reference_psnr: reference.psnr,
                            seconds,
                        };
                        println!("{}", serde_json::to_string(&record)?);
                        records.push(record);
                    }
                    if let Some(folder) = args.pictures.as_deref().filter(|_| number == 0) {
                        std::fs::create_dir_all(folder)?;
                        let exposure = relume_image::metrics::exposure(&reference.clean);
                        for (kind, image) in
                            [("raw", &raw), ("clean", &clean), ("reference", &reference.clean)]
                        {
                            let mut shown = Image::new(image.width, image.height, 3);
                            shown.add_scaled(image, &[0.5 * exposure; 3]);
                            let file = folder.join(format!("{name}_{size}_{samples}_{estimator}_{kind}.png"));
                            write_png(&file, &shown, &ViewTransform::Standard, BitDepth::Eight)?;
                        }
                    }
                }
            }
            std::fs::write(&args.out, serde_json::to_string_pretty(&records)?)
                .context("write the records")?;
        }
    }
    Ok(())
}

/// Light of every lobe.
const ALL_LOBES: ByConnectedLobe<f32> = [1.0; Lobe::CONNECTED.len()];
/// Paths per pixel whose vertices are connected to measure the speed of it.
const PATHS: u32 = 4;

/// Connects the vertices of a few paths to the middle of a light that they face.
fn shadow_rays(scene: &Scene, name: String, seed: u64) -> Result<ShadowRays> {
    let dump = traced(scene, PATHS, 1, Vec::new())?;
    let LightShape::Sphere { center, radius } = random_light(&dump, 0.01, seed).shape else { unreachable!() };
    let tracer = Tracer::new(scene, &TraceSettings::default())?;
    let (width, height) = (scene.camera.width, scene.camera.height);
    let pixels = (0..width * height).map(|pixel| (pixel % width, pixel / width));
    let limits = VertexLimits { first: 2 * PATHS as usize, later: 2 * PATHS as usize };
    let pass = Pass { first_sample: PATHS, samples: PATHS };
    let kept = tracer.path_vertices(pixels, pass, limits, &mut PathScratch::default());
    let middle = LightCenter { position: center, radius };
    let mut connections = Vec::new();
    for vertex in (0..width * height).flat_map(|pixel| kept.pixel(pixel)) {
        let Some(place) = vertex.place(Some(middle), 0.5) else { continue };
        let (direction, distance) = (center - place.position).normalize_and_length();
        if UnpackedVertex::new(vertex).normal().is_none_or(|normal| normal.dot(direction) > 0.0) {
            connections.push((vertex, place, ShadowTarget { direction, distance, blockers: None }));
        }
    }
    let mut scratch = ConnectScratch::default();
    let shadow_rays_per_second = rays_per_second(&connections, |(vertex, place, target)| {
        let vertex = UnpackedVertex::new(vertex);
        tracer.connect(&vertex, *place, *target, ALL_LOBES, [0.5; 4], &mut scratch) != Vec3::ZERO
    });
    let bare_rays_per_second = rays_per_second(&connections, |(_, place, target)| {
        let ray = Ray::new(place.position, target.direction);
        let ray = Ray { t_min: 1e-4, t_max: target.distance, kind: RayKind::Shadow, ..ray };
        tracer.bvh().is_blocked(&ray)
    });
    Ok(ShadowRays { scene: name, shadow_rays_per_second, bare_rays_per_second })
}

struct Reference {
    clean: Image,
    psnr: f64,
}

impl Reference {
    fn new(scene: &Arc<Scene>, light: &Light, samples: u32) -> Result<Self> {
        let half = |seed| -> Result<Image> {
            let dump = traced(scene, samples / 2, seed, vec![light.clone()])?;
            let mut relighter = Relighter::from_dump(dump, Path::new("/nonexistent"))?;
            relighter.connect(Arc::clone(scene))?;
            unit_image(&relighter, light, true)
        };
        let (mut clean, other) = (half(2)?, half(3)?);
        let psnr = quality(&other, &clean).psnr;
        clean.data.iter_mut().zip(&other.data).for_each(|(a, b)| *a = 0.5 * (*a + b));
        Ok(Self { clean, psnr })
    }
}

fn mean(image: &Image) -> f64 {
    image.data.iter().map(|value| f64::from(*value)).sum::<f64>() / image.data.len() as f64
}

fn unit_image(relighter: &Relighter, light: &Light, denoise: bool) -> Result<Image> {
    let options = RelightOptions { method: Method::Gather, denoise, lobes: false };
    let relit = relighter.relight(std::slice::from_ref(light), &options, &Monitor::default())?;
    Ok(relit.lights[0].image.clone())
}

fn traced(scene: &Scene, samples: u32, seed: u64, guide_targets: Vec<Light>) -> Result<Dump> {
    let settings = TraceSettings { samples, seed, guide_targets, ..TraceSettings::default() };
    let tracer = Tracer::new(scene, &settings)?;
    let writer = MemoryWriter::new(tracer.manifest())?;
    tracer.trace(&writer, &Control::default())?;
    Ok(writer.snapshot())
}

fn first_passes(dump: &Dump, samples: u32) -> Dump {
    let mut sum = 0;
    let passes = dump.manifest().passes.iter().take_while(|pass| {
        sum += pass.samples;
        sum <= samples
    });
    dump.passes(0..passes.count())
}

/// A sphere somewhere on a random segment of the paths, of a radius by half of the diagonal of what the paths reach.
fn random_light(dump: &Dump, size: f32, seed: u64) -> Light {
    let shards: Vec<_> = dump.shards().collect();
    let (low, high) = shards.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), shard| {
        (low.min(shard.grid().min), high.max(shard.grid().max))
    });
    let mut rng = Rng::stream(seed, 0x6573_7469, size.to_bits().into());
    loop {
        let shard = shards[(rng.next_f32() * shards.len() as f32) as usize];
        let record = (rng.next_f32() * shard.throughput().len() as f32) as usize;
        let Some(segment) = shard.segment(record) else { continue };
        let End::Vertex(end) = segment.end else { continue };
        let center = segment.origin.lerp(end, 0.2 + 0.6 * rng.next_f32());
        let radius = size * low.distance(high) * 0.5;
        return Light { name: "light".into(), ..Light::unit(LightShape::Sphere { center, radius }) };
    }
}
