//! Speeds of this machine, collected from the crates that own the kernels.

use crate::progress::{Monitor, Stage};
use crate::solve::bench as solve_bench;
use crate::targets::unit_light;
use crate::{Compute, SessionError};
use glam::{Affine3A, Vec2, Vec3};
use relume_dump::MemoryWriter;
use relume_gather::{Gather, GpuGather, Half};
use relume_gpu::Gpu;
use relume_proxy::synthetic::SyntheticRoom;
use relume_proxy::{GpuProxy, LightKind, SizeRange, TrainConfig, Trainer};
use relume_scene::{Camera, Input, Instance, LightShape, Material, Mesh, Node, Scene, SceneBuilder};
use relume_trace::{Control, TraceSettings, Tracer};
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// One measured figure. Peers are other programs measured in the same run; limits are what the machine could do at best.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Record {
    /// What was measured.
    pub name: String,
    /// The figure.
    pub value: f64,
    /// Its unit.
    pub unit: String,
    /// Name of the peer.
    pub peer: Option<String>,
    /// The peer's figure.
    pub peer_value: Option<f64>,
    /// `value / peer_value`.
    pub ratio: Option<f64>,
    /// The limit, in the same unit.
    pub limit: Option<f64>,
    /// `value / limit`.
    pub share_of_limit: Option<f64>,
    /// Name of the GPU; none for the CPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
}

type Measure<'a> = &'a dyn Fn() -> Result<Vec<Record>, SessionError>;

/// Megabytes of made-up positions that the gather reads: well beyond caches.
const GATHER_MEGABYTES: usize = 256;
/// The same on a graphics card, and on a software driver, which is some hundred times slower.
const GPU_GATHER_MEGABYTES: usize = 1024;
const SOFTWARE_GATHER_MEGABYTES: usize = 4;

/// Measures tracer, gather and networks, one after the other; on a GPU, what there is of that there.
///
/// # Errors
/// [`SessionError::Cancelled`] between two of them; if the GPU has not the memory, or was lost.
pub fn bench(compute: &Compute, monitor: &Monitor) -> Result<Vec<Record>, SessionError> {
    match &compute.gpu {
        None => run(&[("tracer", &tracer), ("gather", &gather), ("networks", &networks)], monitor),
        Some(gpu) => {
            let mut records = run(
                &[
                    ("first picture", &|| first_picture(gpu)),
                    ("gather", &|| gather_on(gpu)),
                    ("networks", &|| networks_on(gpu)),
                    ("light", &|| light_on(gpu)),
                ],
                monitor,
            )?;
            records.iter_mut().for_each(|record| record.adapter = Some(gpu.summary().name.clone()));
            Ok(records)
        }
    }
}

/// Size of the picture of [`first_picture`], the paper's.
const PICTURE: (usize, usize) = (885, 500);

/// What passes from the first path to the first relit picture: one path a pixel is traced by the CPU and copied, a light
/// is gathered, and its picture comes back. Kernels are compiled, as on the first use in a process.
fn first_picture(gpu: &Arc<Gpu>) -> Result<Vec<Record>, SessionError> {
    let scene = closed_box(PICTURE)?;
    let tracer = Tracer::new(&scene, &TraceSettings { samples: 1, ..TraceSettings::default() })?;
    let shape = LightShape::Sphere { center: Vec3::new(0.3, 0.2, 0.4), radius: 0.2 };
    let start = Instant::now();
    let writer = MemoryWriter::new(tracer.manifest())?;
    tracer.trace(&writer, &Control::default())?;
    let traced = start.elapsed().as_secs_f64();
    let gather = Gather::new(writer.snapshot());
    let on_gpu = GpuGather::new(Arc::clone(gpu), &gather)?;
    let lights = [gather.prepare(&unit_light(&shape))?];
    let images = on_gpu.unit_images(&lights, Half::All)?;
    let seconds = start.elapsed().as_secs_f64();
    let (width, height) = (images[0].width, images[0].height);
    let record = |what: &str, value: f64| Record {
        name: format!("first picture, closed box, {width} x {height}, {what}"),
        value,
        unit: "s".into(),
        ..Record::default()
    };
    Ok(vec![record("in all", seconds), record("of that after tracing", seconds - traced)])
}

fn run(parts: &[(&str, Measure<'_>)], monitor: &Monitor) -> Result<Vec<Record>, SessionError> {
    let stage = monitor.stage(Stage::Bench, 0, parts.len() as u64);
    let mut records = Vec::new();
    for &(name, measure) in parts {
        if monitor.cancelled() {
            return Err(SessionError::Cancelled);
        }
        records.extend(measure()?);
        stage.advance(1, name);
    }
    Ok(records)
}

fn gather() -> Result<Vec<Record>, SessionError> {
    Ok(relume_gather::bench::measure(GATHER_MEGABYTES)?.into_iter().map(gather_record).collect())
}

fn gather_on(gpu: &Arc<Gpu>) -> Result<Vec<Record>, SessionError> {
    let software = gpu.summary().software;
    let megabytes = if software { SOFTWARE_GATHER_MEGABYTES } else { GPU_GATHER_MEGABYTES };
    Ok(relume_gather::bench::measure_gpu(gpu, megabytes)?.into_iter().map(gather_record).collect())
}

fn gather_record(m: relume_gather::bench::Measurement) -> Record {
    Record {
        share_of_limit: m.share_of_limit(),
        name: m.name,
        value: m.value,
        unit: m.unit.into(),
        limit: m.limit,
        ..Record::default()
    }
}

fn networks() -> Result<Vec<Record>, SessionError> {
    Ok(relume_proxy::bench::kernels()?.into_iter().map(network_record).collect())
}

fn networks_on(gpu: &Arc<Gpu>) -> Result<Vec<Record>, SessionError> {
    Ok(relume_proxy::bench::device(gpu)?.into_iter().map(network_record).collect())
}

/// One light solved as in the paper's section 6.2, through the default network. The limit is that of its products.
fn light_on(gpu: &Arc<Gpu>) -> Result<Vec<Record>, SessionError> {
    let (width, height) = if gpu.summary().software { (177, 100) } else { PICTURE };
    let config = TrainConfig::fast(SizeRange { min: 0.1, max: 0.5 });
    let features = Arc::new(SyntheticRoom::new(width, height).features());
    let trainer = Trainer::new(features, LightKind::Sphere, config, 1)?;
    let proxy = GpuProxy::new(Arc::clone(gpu), &trainer.proxy()?)?;
    let seconds = solve_bench::seconds_of_a_light(&proxy, (width, height))?;
    // Each step goes forward, forward again and backward.
    let evaluated = 3.0 * (solve_bench::STEPS * width * height) as f64 * f64::from(solve_bench::PIXELS);
    let limit = evaluated * trainer.multiply_adds().1 as f64 / gpu.peak_multiply_adds()?;
    let (steps, share) = (solve_bench::STEPS, 100.0 * solve_bench::PIXELS);
    Ok(vec![Record {
        name: format!("one light solved, {steps} steps on {share} % of {width} x {height} pixels"),
        value: seconds,
        unit: "s".into(),
        limit: Some(limit),
        share_of_limit: Some(limit / seconds),
        ..Record::default()
    }])
}

fn network_record(m: relume_proxy::bench::Record) -> Record {
    Record {
        name: m.name,
        value: m.value,
        unit: m.unit.into(),
        limit: Some(m.limit),
        share_of_limit: Some(m.share_of_limit),
        ..Record::default()
    }
}

/// Paths and segments per second in a closed grey box, where no path escapes: the cost of a bounce without that of a scene.
fn tracer() -> Result<Vec<Record>, SessionError> {
    let scene = closed_box((128, 128))?;
    let settings = TraceSettings { samples: 64, ..TraceSettings::default() };
    let tracer = Tracer::new(&scene, &settings)?;
    let (mut best, mut segments) = (f64::INFINITY, 0);
    const ROUNDS: usize = 3;
    for _ in 0..ROUNDS {
        let writer = MemoryWriter::new(tracer.manifest())?;
        let start = Instant::now();
        tracer.trace(&writer, &Control::default())?;
        best = best.min(start.elapsed().as_secs_f64());
        segments = writer.snapshot().record_count();
    }
    let paths = scene.camera.width * scene.camera.height * settings.samples as usize;
    let record = |name: &str, count: usize, unit: &str| Record {
        name: name.into(),
        value: count as f64 / best,
        unit: unit.into(),
        ..Record::default()
    };
    Ok(vec![
        record("trace, closed box, paths", paths, "paths/s"),
        record("trace, closed box, segments", segments, "segments/s"),
    ])
}

pub(crate) fn closed_box((width, height): (usize, usize)) -> Result<Scene, SessionError> {
    let corner = |i: usize| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - Vec3::ONE;
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mesh = Mesh {
        name: "box".into(),
        positions: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect(),
        ..Mesh::default()
    };
    let diffuse = Node::Diffuse { color: Input::Rgb([0.7; 3]), roughness: Input::Float(0.0), normal: None };
    let material = Material { name: "grey".into(), nodes: vec![diffuse], surface: Some(0) };
    let mut builder = SceneBuilder::new("Linear Rec.709");
    builder.set_camera(Camera {
        width,
        height,
        window_min: Vec2::splat(-0.8),
        window_max: Vec2::splat(0.8),
        ..Camera::default()
    });
    let material = builder.add_material_json(&serde_json::to_string(&material).unwrap_or_default())?;
    let mesh = builder.add_mesh(mesh)?;
    builder.add_instance(Instance::new("box", mesh, Affine3A::IDENTITY, vec![material]))?;
    Ok(builder.build()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_path_leaves_the_closed_box() {
        let scene = closed_box((128, 128)).unwrap();
        let tracer = Tracer::new(&scene, &TraceSettings { samples: 1, ..TraceSettings::default() }).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        assert!(writer.snapshot().aovs().depth.data.iter().all(|depth| *depth > 0.9));
    }
}
