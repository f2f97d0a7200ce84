use super::CommandContext;
use super::out_file::check_out;
use crate::args::OptimiseArgs;
use anyhow::Context as _;
use relume_session::{Answer, LightSet, Pictures, Relighter, SolveRequest, Solved, solve_lights};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Finds lights for what the picture should do.
pub fn optimise(args: &OptimiseArgs, context: &CommandContext) -> anyhow::Result<()> {
    check_out(&args.out, "json", "lights are written as JSON")?;
    let compute = context.compute()?;
    let open = |folder: &PathBuf| context.relighter(folder, &compute);
    let relighters = args.bakes.iter().map(open).collect::<anyhow::Result<Vec<_>>>()?;
    let (mut request, folder) = match (&args.request, &args.target) {
        (Some(path), _) => (read_request(path, &relighters[0])?, path.parent().unwrap_or(Path::new(""))),
        (None, target) => (short_request(args, target.as_deref(), context)?, Path::new("")),
    };
    if let Some(path) = &args.from {
        let LightSet { lights, .. } = LightSet::read(path)?;
        request.options.from = Some(Answer { lights, world: request.now.world });
        request.options.steps = 0;
    }
    let views: Vec<&Relighter> = relighters.iter().collect();
    let mut solved = solve_lights(&views, &request, &Pictures::in_folder(folder), context.monitor, &|_| ())?;
    if let Some(path) = &args.lights {
        solved.lights.name = LightSet::read(path)?.name;
    }
    solved.lights.write(&args.out)?;
    solved.warnings.iter().for_each(|warning| context.monitor.warn(warning));
    context
        .console
        .result(&text(args, &solved, request.now.world), &json!({"lights": args.out, "solved": solved}));
    Ok(())
}

/// A request without lights is about those that the bake's scene came with.
fn read_request(path: &Path, relighter: &Relighter) -> anyhow::Result<SolveRequest> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let parse = || -> Result<SolveRequest, String> {
        let mut value: Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
        if let Some(fields) = value.as_object_mut().filter(|fields| !fields.contains_key("lights")) {
            let lights = relighter.scene_lights().map_err(|error| error.to_string())?;
            fields.insert("lights".into(), json!(lights));
        }
        SolveRequest::parse(&value.to_string())
    };
    parse().map_err(|reason| anyhow::anyhow!("request {}: {reason}", path.display()))
}

/// A target picture, and either lights to start from or a number of new ones.
fn short_request(
    args: &OptimiseArgs,
    target: Option<&Path>,
    context: &CommandContext,
) -> anyhow::Result<SolveRequest> {
    let lights = args.lights.as_deref().map(LightSet::read).transpose()?;
    let locked = [
        (args.lock_center, &["position", "direction"][..]),
        (args.lock_radius, &["size", "cone"]),
        (args.lock_radiance, &["color", "strength"]),
    ];
    let free: Vec<&str> =
        locked.iter().filter(|(is_locked, _)| !is_locked).flat_map(|(_, names)| *names).copied().collect();
    let names = lights.iter().flat_map(|set| &set.lights).map(|light| (light.name.clone(), json!(free)));
    let request = json!({
        "lights": lights.as_ref().map_or(json!([]), |set| json!(set)),
        "world": [1, 1, 1],
        "free": names.collect::<serde_json::Map<_, _>>(),
        "add": {"count": if lights.is_some() { 0 } else { args.count }},
        "goals": [{"goal": "target", "image": target}],
        "starts": args.starts,
        "steps": args.iterations,
        "pixel_fraction": args.pixel_fraction,
        "polish": args.polish,
        "seed": context.seed(),
    });
    SolveRequest::parse(&request.to_string()).map_err(|reason| anyhow::anyhow!(reason))
}

fn text(args: &OptimiseArgs, solved: &Solved, world: [f32; 3]) -> String {
    let mut lines = vec![format!(
        "{}: {} lights ({} changed, {} new, {} dropped) in {:.1} s, loss {:.3e} (start {} had {:.3e})",
        args.out.display(),
        solved.lights.lights.len(),
        solved.changed.len(),
        solved.added.len(),
        solved.removed.len(),
        solved.seconds,
        solved.loss,
        solved.start + 1,
        solved.start_loss
    )];
    if solved.world != world {
        let [red, green, blue] = solved.world;
        lines.push(format!("world times {red:.4}, {green:.4}, {blue:.4}, which a light set does not hold"));
    }
    lines.extend(solved.report.iter().map(|report| report.text.clone()));
    if !solved.under_sampled.is_empty() {
        lines.push(format!(
            "hardly any path meets {}: `bake --towards {}` of the scene into another folder, then `optimise` there \
             with --from {}",
            solved.under_sampled.join(", "),
            args.out.display(),
            args.out.display()
        ));
    }
    lines.join("\n")
}
