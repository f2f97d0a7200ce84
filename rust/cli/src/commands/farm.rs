use super::CommandContext;
use super::trace::read;
use crate::args::{CollectArgs, PlanArgs, WorkArgs};
use crate::emit::emit;
use anyhow::bail;
use relume_session::{CollectedBake, PLAN_FILE, Shot};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::PathBuf;

#[derive(Serialize)]
struct Planned {
    plan: PathBuf,
    parts: usize,
    bakes: Vec<PathBuf>,
    emitted: Vec<PathBuf>,
}

/// Writes a job folder.
pub fn plan(args: &PlanArgs, context: &CommandContext) -> anyhow::Result<()> {
    let shot = |path: &PathBuf| -> anyhow::Result<Shot> {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Shot { name, file: read(path, &args.settings, context)? })
    };
    let plan = relume_session::plan(&args.out, args.scenes.iter().map(shot), args.parts, context.monitor)?;
    let emitted = args.emit.iter().map(|farm| emit(*farm, &args.out, plan.parts()));
    let emitted = emitted.collect::<anyhow::Result<Vec<PathBuf>>>()?;
    let bakes: Vec<PathBuf> = plan.bakes.iter().map(|bake| args.out.join(&bake.folder)).collect();
    let job = args.out.display();
    let text = format!(
        "{job}: {} bakes, {} parts; trace them with: relume work {job} --part NUMBER, then: relume collect {job}",
        bakes.len(),
        plan.parts()
    );
    let planned = Planned { plan: args.out.join(PLAN_FILE), parts: plan.parts(), bakes, emitted };
    context.console.result(&text, &planned);
    Ok(())
}

/// Traces parts of a job.
pub fn work(args: &WorkArgs, context: &CommandContext) -> anyhow::Result<()> {
    let report = relume_session::work(&args.plan, &args.part.0, context.monitor)?;
    let text = format!(
        "{} parts: {} of {} shards traced, {:.1} s",
        report.parts.len(),
        report.traced,
        report.shards,
        report.seconds
    );
    context.console.result(&text, &report);
    Ok(())
}

#[derive(Serialize)]
struct Collected {
    bakes: Vec<CollectedBake>,
}

/// Checks a job; an error if anything is missing or damaged.
pub fn collect(args: &CollectArgs, context: &CommandContext) -> anyhow::Result<()> {
    let bakes = relume_session::collect(&args.plan, context.monitor)?;
    let missing: BTreeSet<usize> = bakes.iter().flat_map(|bake| bake.missing.iter().copied()).collect();
    for bake in &bakes {
        bake.faults
            .iter()
            .for_each(|fault| context.monitor.warn(&format!("{}: {fault}", bake.folder.display())));
    }
    let job = args.plan.display();
    if !missing.is_empty() {
        let parts = ranges(&missing);
        bail!(
            "parts {parts} are missing or damaged, see above; trace them with: relume work {job} --part {parts}"
        );
    }
    if let Some(bake) = bakes.iter().find(|bake| !bake.faults.is_empty()) {
        bail!("{} has damaged files, see above; restore them, or plan again", bake.folder.display());
    }
    context.console.result(&format!("{job}: {} bakes, sound", bakes.len()), &Collected { bakes });
    Ok(())
}

/// Numbers as `--part` takes them.
fn ranges(numbers: &BTreeSet<usize>) -> String {
    let mut ranges = Vec::<(usize, usize)>::new();
    for &number in numbers {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == number => *last = number,
            _ => ranges.push((number, number)),
        }
    }
    let words = |(first, last): (usize, usize)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    ranges.into_iter().map(words).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Parts;

    #[test]
    fn missing_parts_are_named_as_work_takes_them() {
        let numbers = [1, 3, 4, 5, 9];
        let text = ranges(&numbers.into());
        assert_eq!(text, "1,3-5,9");
        assert_eq!(text.parse(), Ok(Parts(numbers.to_vec())));
    }
}
