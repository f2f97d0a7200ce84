//! Speeds of this machine, and what it could do at best: `relume-bench`, a program of the checkout.

mod device;
mod figure;
mod gather;
mod goals;
mod live;
mod networks;
mod peak;
mod rays;
mod record;
mod scenes;
mod shaders;
mod solve;
mod strands;
mod timing;

use std::time::Instant;

use anyhow::{Result, bail};
use relume_dump::MemoryWriter;
use relume_session::{Compute, Device};
use relume_trace::{Control, TraceSettings, Tracer};

use figure::Figure;
use gather::on_gpu::PAPER;
use networks::NetworkExtent;
pub use rays::rays_per_second;
pub use record::FigureRecord;
use record::today;
use scenes::closed_box;

/// A part of the benchmark: its name and what it does.
struct BenchPart<'a>(&'static str, Box<dyn Fn() -> Result<Vec<FigureRecord>> + 'a>);

/// Choice of parts.
#[derive(Clone, Debug, Default)]
pub struct BenchOptions {
    /// Parts by their names; all if none is here.
    pub parts: Vec<String>,
    /// True for the least that shows that everything runs, in seconds. The figures are called `trial: ...` and say nothing.
    pub trial: bool,
}

/// Extent of each part; pictures in pixels.
#[derive(Clone, Copy, Debug)]
struct Extent {
    /// Picture and samples of the tracer.
    traced: ((usize, usize), u32),
    /// Triangles along an edge of the cave that rays are shot in, and rays.
    rays: (usize, usize),
    /// Hairs of a head, and rays.
    strands: (usize, usize),
    /// Megabytes of made-up positions that the gather reads.
    gather_megabytes: usize,
    networks: NetworkExtent,
    /// The first picture.
    first: (usize, usize),
    /// The picture of an edit.
    edited: (usize, usize),
    /// Picture and samples of `paper`.
    paper: (usize, usize, usize),
    /// Picture and steps of the light that is solved.
    picture: (usize, usize),
    steps: usize,
}

impl Extent {
    /// The paper's sizes, and bytes well beyond caches.
    const CARD: Self = Self {
        traced: ((128, 128), 64),
        rays: (300, 50_000),
        strands: (100_000, 50_000),
        gather_megabytes: 1024,
        networks: NetworkExtent::CARD,
        first: (PAPER.0, PAPER.1),
        edited: (PAPER.0, PAPER.1),
        paper: PAPER,
        picture: (PAPER.0, PAPER.1),
        steps: solve::STEPS,
    };
    const CPU: Self = Self { gather_megabytes: 256, networks: NetworkExtent::CPU, ..Self::CARD };
    /// A software driver is some hundred times slower than a card.
    const SOFTWARE: Self = Self {
        gather_megabytes: 4,
        networks: NetworkExtent::SOFTWARE,
        edited: (88, 50),
        paper: (PAPER.0, PAPER.1, 1),
        picture: (177, 100),
        ..Self::CARD
    };
    const TRIAL: Self = Self {
        traced: ((16, 16), 4),
        rays: (10, 100),
        strands: (2_000, 400),
        gather_megabytes: 1,
        networks: NetworkExtent::TRIAL,
        first: (32, 20),
        edited: (32, 20),
        paper: (32, 20, 4),
        picture: (40, 30),
        steps: 5,
    };

    fn new(compute: &Compute, trial: bool) -> Self {
        match &compute.gpu {
            _ if trial => Self::TRIAL,
            None => Self::CPU,
            Some(gpu) if gpu.summary().software => Self::SOFTWARE,
            Some(_) => Self::CARD,
        }
    }
}

/// Measures tracer, rays, gather and networks, one after the other. On a GPU: its limits, the time to a first picture and to that of
/// an edit, gathers (`paper`: at the size of the paper's), networks, what checks in kernels cost, and one light solved. `keep` is
/// called with the name and the records of each part as soon as that is done.
///
/// # Errors
/// If there is no such device or part; the error of `keep`; if the GPU has not the memory, or was lost.
pub fn bench(
    device: &Device,
    options: &BenchOptions,
    keep: &mut dyn FnMut(&str, &[FigureRecord]) -> Result<()>,
) -> Result<Vec<FigureRecord>> {
    let compute = device.open(None)?;
    let mut parts = parts(device, &compute, Extent::new(&compute, options.trial));
    let only = &options.parts;
    let names: Vec<_> = parts.iter().map(|part| part.0).collect();
    if let Some(unknown) = only.iter().find(|name| !names.contains(&name.as_str())) {
        let there = names.join(", ");
        bail!("the benchmark of this device has no part {unknown}; there are: {there}");
    }
    parts.retain(|part| only.is_empty() || only.iter().any(|name| name == part.0));
    let adapter = compute.gpu.as_ref().map(|gpu| gpu.summary().name.clone());
    let mut all = Vec::new();
    for BenchPart(name, measure) in parts {
        let mut records = measure()?;
        for record in &mut records {
            record.adapter.clone_from(&adapter);
            record.date = today();
            if options.trial {
                record.name.insert_str(0, "trial: ");
            }
            if adapter.is_some() {
                goals::compare(record);
            }
        }
        keep(name, &records)?;
        all.extend(records);
    }
    Ok(all)
}

fn parts<'a>(device: &'a Device, compute: &'a Compute, of: Extent) -> Vec<BenchPart<'a>> {
    let Some(gpu) = &compute.gpu else {
        return vec![
            BenchPart("tracer", Box::new(move || tracer(of.traced))),
            BenchPart("rays", Box::new(move || rays::measure(of.rays))),
            BenchPart("strands", Box::new(move || strands::measure(of.strands))),
            BenchPart("gather", Box::new(move || Ok(records(gather::measure(of.gather_megabytes)?)))),
            BenchPart("networks", Box::new(move || Ok(records(networks::kernels(of.networks)?)))),
        ];
    };
    vec![
        BenchPart("device", Box::new(|| device::limits(gpu))),
        BenchPart("first-picture", Box::new(move || device::first_picture(gpu, of.first))),
        BenchPart("edit", Box::new(move || device::edit(device, gpu, of.edited))),
        BenchPart("gather", Box::new(move || device::gather(gpu, of.gather_megabytes))),
        BenchPart("paper", Box::new(move || device::paper_gather(gpu, of.paper))),
        BenchPart("networks", Box::new(move || device::networks(gpu, of.networks))),
        BenchPart("checks", Box::new(move || device::checks(gpu, of.gather_megabytes, of.networks))),
        BenchPart("light", Box::new(move || device::light(gpu, of.picture, of.steps))),
    ]
}

fn records(figures: Vec<Figure>) -> Vec<FigureRecord> {
    figures.into_iter().map(FigureRecord::from).collect()
}

/// Paths and segments per second in a closed grey box, where no path escapes: the cost of a bounce without that of a scene.
fn tracer((size, samples): ((usize, usize), u32)) -> Result<Vec<FigureRecord>> {
    let scene = closed_box(size)?;
    let settings = TraceSettings { samples, ..TraceSettings::default() };
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
    let record = |name: &str, count: usize, unit| Figure::new(name, count as f64 / best, unit).into();
    Ok(vec![
        record("trace, closed box, paths", paths, "paths/s"),
        record("trace, closed box, segments", segments, "segments/s"),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_gpu::GpuChoice;

    /// Kept part by part, and all of them.
    fn trial_of(device: &Device) -> Vec<Vec<FigureRecord>> {
        let mut kept = Vec::new();
        let keep = &mut |_: &str, records: &[FigureRecord]| {
            kept.push(records.to_vec());
            Ok(())
        };
        let options = BenchOptions { trial: true, ..BenchOptions::default() };
        let records = bench(device, &options, keep).unwrap();
        assert_eq!(kept.concat(), records);
        kept
    }

    /// Names, without what all of a trial begin with, and units.
    fn figures(records: &[FigureRecord]) -> Vec<(&str, &str)> {
        let name =
            |record: &'_ FigureRecord| record.name.strip_prefix("trial: ").expect("called a trial").len();
        records.iter().map(|r| (&r.name[r.name.len() - name(r)..], r.unit.as_str())).collect()
    }

    /// Asserts that all are numbers above 0 and fit their limits, and that nothing else is said of them.
    fn check(records: &[FigureRecord], adapter: Option<&str>) {
        for record in records {
            let is_of_driver = record.name.starts_with("trial: driver: ");
            assert!(record.value.is_finite() && (record.value > 0.0 || is_of_driver), "{record:?}");
            assert_eq!((record.adapter.as_deref(), record.date.as_str()), (adapter, today().as_str()));
            let ratio = record.peer_value.map(|of_peer| record.value / of_peer);
            assert_eq!(
                (record.goal, record.peer.is_some(), record.ratio),
                (None, ratio.is_some(), ratio),
                "{record:?}"
            );
            assert_eq!(record.limit.is_some(), record.limit_by.is_some(), "{record:?}");
            let is_time = ["s", "ms"].contains(&record.unit.as_str());
            let share = |limit: f64| if is_time { limit / record.value } else { record.value / limit };
            match (record.limit.map(share), record.share_of_limit) {
                (Some(share), Some(said)) => {
                    assert!(said > 0.0 && (said / share - 1.0).abs() < 1e-9, "{record:?}")
                }
                (limit, said) => assert_eq!(limit, said, "{record:?}"),
            }
        }
    }

    /// Networks of a trial: the narrow ones.
    const NETWORKS: [&str; 2] = ["reference 64/4", "fast 64x2"];

    #[test]
    fn a_trial_of_a_gpu_has_all_figures_of_all_parts() {
        let device = Device::Gpu(GpuChoice::Best);
        let kept = trial_of(&device);
        let gpu = device.open(None).unwrap().gpu.unwrap();
        check(&kept.concat(), Some(&gpu.summary().name));
        let [device, first, edit, gather, paper, networks, checks, light] = &kept[..] else {
            panic!("{} parts", kept.len());
        };
        let has = |records: &[FigureRecord], name: &str, unit: &str| {
            assert!(figures(records).contains(&(name, unit)), "no {name} in {unit}: {:?}", figures(records));
        };
        has(device, "driver: bytes of a buffer", "");
        has(device, "peak of 32-bit floats", "TFLOP/s");
        for rate in ["plain read of several buffers", "copy from the CPU to the device"] {
            has(device, rate, "GB/s");
        }
        has(device, "a submission that is waited for", "us");
        let name = |what: &str| format!("first picture, closed box, 32 x 20, {what}");
        let names = [name("in all"), name("of that after tracing")];
        assert_eq!(figures(first), [(names[0].as_str(), "s"), (&names[1], "s")]);
        let name = |what: &str| format!("strength of one of 20 lights dragged, 32 x 20, {what}");
        let names = [name("to the picture"), name("copied to the CPU")];
        assert_eq!(figures(edit), [(names[0].as_str(), "ms"), (&names[1], "MB")]);
        assert_eq!(gather.len(), 13);
        has(gather, "gather of 32 sphere lights, on the GPU", "G segments/s");
        has(gather, "pixel targets of a streamed dump, 4 lights a pixel, on the GPU", "targets/s");
        let size = "32 x 20 at 4 samples";
        for layout in ["", " in the paper's layout"] {
            for lights in ["1 sphere light", "8 sphere lights", "32 sphere lights"] {
                has(paper, &format!("gather of {lights}{layout}, {size}"), "ms");
            }
            has(paper, &format!("positions read for 1 sphere light{layout}, {size}"), "GB/s");
        }
        has(paper, &format!("gather of a light of a tenth of the room, sorted, {size}"), "ms");
        assert_eq!(paper.len(), 9);
        for network in NETWORKS {
            for task in ["inference kernel", "unit image with read-back", "light step on 5 % of the pixels"] {
                has(networks, &format!("{task} {network}, 20 x 12"), "ms");
            }
            let error = format!("largest error of inference kernel {network}, 20 x 12");
            has(networks, &error, "of the largest value");
            let training = format!("training on 1024 samples an iteration {network}, 20 x 12");
            has(networks, &training, "iterations/s");
        }
        let tasks = ["gather of 1 sphere light", "inference kernel reference 64/4, 20 x 12"];
        let names = tasks.map(|task| format!("{task}, with checks of indices and loops"));
        assert_eq!(figures(checks), [(names[0].as_str(), "ms"), (&names[1], "ms")]);
        assert!(checks.iter().all(|record| record.ratio.is_some()), "{checks:?}");
        assert_eq!(figures(light), [("one light solved, 5 steps on 1 % of 40 x 30 pixels", "s")]);
    }

    #[test]
    fn a_trial_of_the_cpu_has_all_figures_of_all_parts() {
        let kept = trial_of(&Device::Cpu);
        let [tracer, rays, strands, gather, networks] = &kept[..] else { panic!("{} parts", kept.len()) };
        let traced =
            ["paths", "segments"].map(|what| (format!("trace, closed box, {what}"), format!("{what}/s")));
        let expected: Vec<_> = traced.iter().map(|(name, unit)| (name.as_str(), unit.as_str())).collect();
        assert_eq!(figures(tracer), expected);
        check(&[&tracer[..], gather, networks].concat(), None);
        assert_eq!((rays.len(), strands.len()), (1 + 3 * 2, 2 * 4));
        let units = ["GB/s", "G segments/s", "targets/s"];
        assert!(figures(gather).iter().all(|(_, unit)| units.contains(unit)), "{gather:?}");
        assert!(gather.len() > 10, "{gather:?}");
        let names: Vec<_> = NETWORKS
            .iter()
            .flat_map(|network| {
                ["inference", "training"].map(|task| format!("{task} {network}, one thread, "))
            })
            .collect();
        assert_eq!(networks.len(), names.len());
        for (record, name) in figures(networks).iter().zip(&names) {
            assert!(record.0.starts_with(name) && record.1 == "samples/s", "{record:?} is not {name}");
        }
    }

    #[test]
    fn a_part_that_there_is_not_is_answered_with_those_that_there_are() {
        let of = |device: &Device| {
            let options = BenchOptions { parts: vec!["tracer".into(), "all".into()], trial: true };
            let keep =
                &mut |_: &str, _: &[FigureRecord]| -> Result<()> { panic!("nothing was to be measured") };
            bench(device, &options, keep).unwrap_err().to_string()
        };
        let on_cpu = of(&Device::Cpu);
        assert!(
            on_cpu.contains("no part all") && on_cpu.contains("tracer, rays, strands, gather, networks"),
            "{on_cpu}"
        );
        let on_gpu = of(&Device::Gpu(GpuChoice::Best));
        assert!(
            on_gpu.contains("no part tracer") && on_gpu.contains("device, first-picture, edit"),
            "{on_gpu}"
        );
    }
}
