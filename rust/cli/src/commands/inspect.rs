use super::CommandContext;
use crate::args::PathArgs;
use relume_session::{Info, ProxySummary, info as read_info, validate as find_problems};
use serde::Serialize;

/// Describes a file or folder.
pub fn info(args: &PathArgs, context: &CommandContext) -> anyhow::Result<()> {
    let info = read_info(&args.path)?;
    context.console.result(&text(&info), &info);
    Ok(())
}

fn text(info: &Info) -> String {
    match info {
        Info::Bake { manifest, shards, records, bytes, lights, proxies, lost } => {
            let mut lines = vec![
                format!(
                    "bake of {} x {} pixels, {} paths per pixel",
                    manifest.width,
                    manifest.height,
                    manifest.samples()
                ),
                format!("scene {}", manifest.scene_hash),
                format!(
                    "{} of {} shards, {records} records, {:.1} MiB",
                    shards[0],
                    shards[1],
                    *bytes as f64 / f64::from(1 << 20)
                ),
                lights_line(lights),
            ];
            lines.extend(proxies.iter().map(proxy_line));
            lines.extend(warning_lines(lost));
            lines.join("\n")
        }
        Info::Proxies { proxies, lost } => {
            let lines: Vec<String> = proxies.iter().map(proxy_line).chain(warning_lines(lost)).collect();
            lines.join("\n")
        }
        Info::Proxy { info } => proxy_line(&ProxySummary { info: (**info).clone(), measured: None }),
        Info::Lights { name, lights, notes } => {
            let names = lights.iter().map(|light| format!("  {}", light.name));
            let notes = notes.iter().map(|note| format!("  note: {note}"));
            let lines: Vec<String> = [format!("light set '{name}', {} lights", lights.len())]
                .into_iter()
                .chain(names)
                .chain(notes)
                .collect();
            lines.join("\n")
        }
        Info::Scene {
            scene_hash,
            resolution: [width, height],
            samples,
            instances,
            triangles,
            lights,
            warnings,
        } => {
            let lines = [
                format!("scene of {width} x {height} pixels, {samples} paths per pixel"),
                format!("scene {scene_hash}"),
                format!("{instances} objects, {triangles} triangles"),
                lights_line(lights),
            ];
            lines.into_iter().chain(warning_lines(warnings)).collect::<Vec<_>>().join("\n")
        }
    }
}

fn warning_lines(warnings: &[String]) -> impl Iterator<Item = String> {
    warnings.iter().map(|warning| format!("warning: {warning}"))
}

fn lights_line(names: &[String]) -> String {
    format!("lights: {}", if names.is_empty() { "none".into() } else { names.join(", ") })
}

fn proxy_line(summary: &ProxySummary) -> String {
    let info = &summary.info;
    let scores = match (&summary.measured, &info.held_out) {
        (Some(m), _) => {
            format!("; {:.1} dB against {:.1} dB of gather, denoised", m.proxy.psnr, m.gather_denoised.psnr)
        }
        (None, Some(scores)) => format!("; held out {:.1} dB, SMAPE {:.3}", scores.psnr, scores.smape),
        (None, None) => String::new(),
    };
    format!(
        "proxy for {} lights of {:.3} to {:.3} m, {:.1} M samples{scores}",
        info.kind,
        info.size.min,
        info.size.max,
        info.samples as f64 / 1e6
    )
}

#[derive(Serialize)]
struct Checked {
    problems: Vec<String>,
}

/// Lists damage; an error if there is any.
pub fn validate(args: &PathArgs, context: &CommandContext) -> anyhow::Result<()> {
    let problems = find_problems(&args.path, context.monitor)?;
    match problems.len() {
        0 => {
            context.console.result(&format!("{}: sound", args.path.display()), &Checked { problems });
            Ok(())
        }
        count => {
            let s = if count == 1 { "" } else { "s" };
            problems.iter().for_each(|problem| context.monitor.warn(problem));
            anyhow::bail!("{} has {count} problem{s}, listed above", args.path.display())
        }
    }
}
