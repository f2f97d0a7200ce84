use super::Context;
use crate::args::BenchArgs;
use relume_session::bench::{Record, bench as measure};
use relume_session::image::write_atomically;
use serde::Serialize;

#[derive(Serialize)]
struct Measured {
    records: Vec<Record>,
}

/// Measures this machine: the GPU of `--device`, or the CPU.
pub fn bench(args: &BenchArgs, context: &Context) -> anyhow::Result<()> {
    let records = measure(&context.compute()?, context.monitor)?;
    if let Some(path) = &args.out {
        write_atomically(path, |writer| Ok(serde_json::to_writer_pretty(writer, &records)?))?;
    }
    let lines: Vec<String> = records.iter().map(line).collect();
    context.console.result(&lines.join("\n"), &Measured { records });
    Ok(())
}

fn line(record: &Record) -> String {
    let share = record
        .share_of_limit
        .map(|share| format!("  {:.0} % of the limit", 100.0 * share))
        .unwrap_or_default();
    format!("{:<44} {:>12.4e} {}{share}", record.name, record.value, record.unit)
}
