//! Speeds of this machine, collected from the crates that own the kernels.

mod device;
mod goals;

use crate::progress::{Monitor, Stage};
use crate::{Compute, SessionError};
use glam::{Affine3A, Vec2, Vec3};
use relume_dump::MemoryWriter;
use relume_scene::{Camera, Input, Instance, Material, Mesh, Node, Scene, SceneBuilder};
use relume_trace::{Control, TraceSettings, Tracer};
use serde::{Deserialize, Serialize};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// One measured figure. Peers are other programs measured in the same run, or the paper; limits are what the machine could do at
/// best.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// `value / limit`; of a time, `limit / value`.
    pub share_of_limit: Option<f64>,
    /// What an NVIDIA H200 is to reach, in the same unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<f64>,
    /// Name of the GPU; none for the CPU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    /// Day of the measurement in universal time, `2026-11-22`.
    #[serde(default)]
    pub date: String,
}

/// A part of the benchmark: its name and what it does.
struct Part<'a>(&'static str, Box<dyn Fn() -> Result<Vec<Record>, SessionError> + 'a>);

/// Megabytes of made-up positions that the gather reads: well beyond caches.
const GATHER_MEGABYTES: usize = 256;

/// Measures tracer, gather and networks, one after the other; on a GPU its limits, the time to a first picture and to that of an edit,
/// gathers (`paper`: at the size of the paper's), networks, and one light solved. If `only` names some of these parts, only those. `keep` is called
/// with the records of each part as soon as that is done.
///
/// # Errors
/// [`SessionError::Settings`] for a part that there is not; [`SessionError::Cancelled`] between two of them; what `keep` says; if
/// the GPU has not the memory, or was lost.
pub fn bench(
    compute: &Compute,
    only: &[String],
    keep: &mut dyn FnMut(&[Record]) -> Result<(), SessionError>,
    monitor: &Monitor,
) -> Result<Vec<Record>, SessionError> {
    let mut parts = parts(compute);
    let names: Vec<_> = parts.iter().map(|part| part.0).collect();
    if let Some(unknown) = only.iter().find(|name| !names.contains(&name.as_str())) {
        let there = names.join(", ");
        return Err(SessionError::Settings(format!(
            "the benchmark of this device has no part {unknown}; there are: {there}"
        )));
    }
    parts.retain(|part| only.is_empty() || only.iter().any(|name| name == part.0));
    let adapter = compute.gpu.as_ref().map(|gpu| gpu.summary().name.clone());
    let stage = monitor.stage(Stage::Bench, 0, parts.len() as u64);
    let mut all = Vec::new();
    for Part(name, measure) in parts {
        if monitor.cancelled() {
            return Err(SessionError::Cancelled);
        }
        let mut records = measure()?;
        for record in &mut records {
            record.adapter.clone_from(&adapter);
            record.date = today();
            if adapter.is_some() {
                goals::compare(record);
            }
        }
        keep(&records)?;
        all.extend(records);
        stage.advance(1, name);
    }
    Ok(all)
}

fn parts(compute: &Compute) -> Vec<Part<'_>> {
    let Some(gpu) = &compute.gpu else {
        return vec![
            Part("tracer", Box::new(tracer)),
            Part("gather", Box::new(gather)),
            Part("networks", Box::new(networks)),
        ];
    };
    vec![
        Part("device", Box::new(|| device::limits(gpu))),
        Part("first-picture", Box::new(|| device::first_picture(gpu))),
        Part("edit", Box::new(|| device::edit(gpu))),
        Part("gather", Box::new(|| device::gather(gpu))),
        Part("paper", Box::new(|| device::paper_gather(gpu))),
        Part("networks", Box::new(|| device::networks(gpu))),
        Part("light", Box::new(|| device::light(gpu))),
    ]
}

/// The day in universal time, `2026-11-22`.
fn today() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    date_of(seconds / 86_400)
}

/// The date so many days after 1970-01-01, by Hinnant's `civil_from_days` (howardhinnant.github.io/date_algorithms.html): years start
/// in March, so that leap days come last.
fn date_of(days: u64) -> String {
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (year, month) = (era * 400 + year + u64::from(month >= 10), (month + 2) % 12 + 1);
    format!("{year:04}-{month:02}-{day:02}")
}

fn gather() -> Result<Vec<Record>, SessionError> {
    Ok(relume_gather::bench::measure(GATHER_MEGABYTES)?.into_iter().map(gather_record).collect())
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
    use crate::Device;
    use relume_gpu::GpuChoice;

    #[test]
    fn no_path_leaves_the_closed_box() {
        let scene = closed_box((128, 128)).unwrap();
        let tracer = Tracer::new(&scene, &TraceSettings { samples: 1, ..TraceSettings::default() }).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        assert!(writer.snapshot().aovs().depth.data.iter().all(|depth| *depth > 0.9));
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (days, date) in
            [(0, "1970-01-01"), (11_016, "2000-02-29"), (11_017, "2000-03-01"), (20_779, "2026-11-22")]
        {
            assert_eq!(date_of(days), date);
        }
    }

    #[test]
    fn parts_of_a_gpu_are_kept_one_by_one_with_adapter_and_date() {
        let compute = Device::Gpu(GpuChoice::Best).open(None).unwrap();
        let only = ["device", "first-picture", "edit"].map(str::to_owned);
        let mut kept = Vec::new();
        let keep = &mut |records: &[Record]| {
            kept.push(records.to_vec());
            Ok(())
        };
        let records = bench(&compute, &only, keep, &Monitor::default()).unwrap();
        assert_eq!(kept.len(), 3);
        assert_eq!(kept.concat(), records);
        let adapter = compute.gpu.as_ref().map(|gpu| gpu.summary().name.clone());
        assert!(records.iter().all(|record| record.adapter == adapter && record.date == today()));
        let unknown = bench(&compute, &["all".to_owned()], &mut |_| Ok(()), &Monitor::default());
        assert!(unknown.unwrap_err().to_string().contains("first-picture"));
    }
}
