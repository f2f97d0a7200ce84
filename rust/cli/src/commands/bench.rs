use super::Context;
use crate::args::BenchArgs;
use relume_session::SessionError;
use relume_session::bench::{BenchOptions, Record, bench as measure};
use relume_session::image::write_atomically;
use serde::Serialize;
use std::path::Path;

#[derive(Serialize)]
struct Measured {
    records: Vec<Record>,
}

/// Measures this machine: the GPU of `--device`, or the CPU.
pub fn bench(args: &BenchArgs, context: &Context) -> anyhow::Result<()> {
    let mut file = match &args.out {
        Some(path) if args.add && path.exists() => read(path)?,
        _ => Vec::new(),
    };
    let keep = &mut |records: &[Record]| -> Result<(), SessionError> {
        let Some(path) = &args.out else { return Ok(()) };
        file.retain(|old| records.iter().all(|new| new.name != old.name));
        file.extend_from_slice(records);
        Ok(write_atomically(path, |writer| Ok(serde_json::to_writer_pretty(writer, &file)?))?)
    };
    let options = BenchOptions { parts: args.part.clone(), trial: args.trial };
    let records = measure(&context.compute()?, &options, keep, context.monitor)?;
    let lines: Vec<String> = records.iter().map(line).collect();
    context.console.result(&lines.join("\n"), &Measured { records });
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<Vec<Record>> {
    let text = std::fs::read(path)?;
    serde_json::from_slice(&text).map_err(|error| {
        let path = path.display();
        anyhow::anyhow!("{path} holds no records of a benchmark ({error}); remove it, or leave out --add")
    })
}

fn line(record: &Record) -> String {
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
