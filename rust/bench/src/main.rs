//! Measures this machine: the CPU, or a GPU.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use relume_bench::{BenchOptions, FigureRecord, bench};
use relume_session::Device;
use relume_session::image::write_atomically;
use serde::Serialize;

/// Measures the speed of tracer, gather and networks on the CPU, or of what there is of that on a GPU.
#[derive(Parser, Debug)]
#[command(name = "relume-bench", version)]
struct Args {
    /// JSON file to write: a list of flat records. It is written anew after each part.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Keep what the JSON file holds of other figures.
    #[arg(long, requires = "out")]
    add: bool,
    /// Measure this part alone; can be given several times. Without it, all parts; a name that there is not lists them.
    #[arg(long)]
    part: Vec<String>,
    /// Measure as little as there can be, in seconds, to see that everything runs: figures called `trial: ...`, which say nothing.
    #[arg(long)]
    trial: bool,
    /// Print one line of JSON.
    #[arg(long)]
    json: bool,
    /// Print no progress.
    #[arg(long)]
    quiet: bool,
    /// Device to measure: auto (the best graphics card, else the CPU), cpu, gpu, or what `relume devices` prints.
    #[arg(long, default_value = "auto")]
    device: Device,
}

#[derive(Serialize)]
struct MeasuredRecords {
    records: Vec<FigureRecord>,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("relume-bench: error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<()> {
    let mut file = match &args.out {
        Some(path) if args.add && path.exists() => read(path)?,
        _ => Vec::new(),
    };
    let keep = &mut |part: &str, records: &[FigureRecord]| -> Result<()> {
        if !args.quiet {
            eprintln!("relume-bench: {part} is measured");
        }
        let Some(path) = &args.out else { return Ok(()) };
        file.retain(|old| records.iter().all(|new| new.name != old.name));
        file.extend_from_slice(records);
        Ok(write_atomically(path, |writer| Ok(serde_json::to_writer_pretty(writer, &file)?))?)
    };
    let options = BenchOptions { parts: args.part.clone(), trial: args.trial };
    let records = bench(&args.device, &options, keep)?;
    if args.json {
        println!("{}", serde_json::to_string(&MeasuredRecords { records })?);
    } else {
        records.iter().for_each(|record| println!("{}", line(record)));
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<FigureRecord>> {
    let text = std::fs::read(path)?;
    serde_json::from_slice(&text).map_err(|error| {
        let path = path.display();
        anyhow::anyhow!("{path} holds no records of a benchmark ({error}); remove it, or leave out --add")
    })
}

fn line(record: &FigureRecord) -> String {
    let by = record.limit_by.iter().map(|by| format!(" by {by}")).collect::<String>();
    let share = record.share_of_limit.zip(record.limit);
    let share = share.map(|(share, limit)| format!("  {:.0} % of {limit:.4}{by}", 100.0 * share));
    let goal = record.goal.map(|goal| format!("  goal {goal:.4}"));
    let peer = record.peer.iter().zip(record.peer_value);
    let ratio = record.ratio.map(|ratio| format!(", ratio {ratio:.3}")).unwrap_or_default();
    let peer = peer.map(|(peer, value)| format!("  {peer}: {value:.4}{ratio}"));
    let beside: String = share.into_iter().chain(goal).chain(peer).collect();
    format!("{:<76} {:>12.4e} {}{beside}", record.name, record.value, record.unit).trim_end().to_owned()
}
