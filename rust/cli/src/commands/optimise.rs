use super::CommandContext;
use super::out_file::{SHOT, check_out};
use crate::args::OptimiseArgs;
use anyhow::Context as _;
use relume_session::{Answer, LightSet, Pictures, Relighter, ShotList, SolveRequest, Solved, solve_lights};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Finds lights for what the picture should do.
pub fn optimise(args: &OptimiseArgs, context: &CommandContext) -> anyhow::Result<()> {
    check_out(&args.out, "json", "lights are written as JSON")?;
    let compute = context.compute()?;
    let views = Views::of(args)?;
    let open = |folder: &PathBuf| {
        let mut relighter = context.relighter(folder, &compute)?;
        relighter.connect_stored(context.monitor);
        Ok(relighter)
    };
    let relighters = views.bakes.iter().map(open).collect::<anyhow::Result<Vec<_>>>()?;
    let (mut request, folder) = match &args.request {
        Some(path) => (read_request(path, &views, &relighters[0])?, path.parent().unwrap_or(Path::new(""))),
        None => (short_request(args, &views, context)?, Path::new("")),
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

/// The bakes of a solve, in the order of its views, and the names of the shots where they come from a list.
struct Views {
    bakes: Vec<PathBuf>,
    /// Name, and name in files.
    shots: Vec<(String, String)>,
}

impl Views {
    /// The folders that are named, or the shots of a list. Where goals name shots, the others are left out.
    fn of(args: &OptimiseArgs) -> anyhow::Result<Self> {
        let Some(path) = &args.shots else {
            return Ok(Self { bakes: args.bakes.clone(), shots: Vec::new() });
        };
        let list = ShotList::read(path)?;
        let named = match &args.request {
            Some(path) => shots_of_goals(&json_file(path)?),
            None => Vec::new(),
        };
        let is_listed = |name: &&String| list.shots.iter().any(|shot| shot.name == **name);
        if let Some(unknown) = named.iter().find(|name| !is_listed(name)) {
            anyhow::bail!("{} has no shot '{unknown}', which a goal names", path.display());
        }
        let files = list.file_names();
        let wanted = list.shots.iter().zip(files);
        let wanted = wanted.filter(|(shot, _)| named.is_empty() || named.contains(&shot.name));
        let (bakes, shots) =
            wanted.map(|(shot, file)| (shot.bake.clone(), (shot.name.clone(), file))).unzip();
        Ok(Self { bakes, shots })
    }

    /// Replaces the "shot" of each goal by the number of its view.
    fn number(&self, goals: &mut Value) -> Result<(), String> {
        for (number, goal) in goals.as_array_mut().into_iter().flatten().enumerate() {
            let Some(fields) = goal.as_object_mut() else { continue };
            let Some(shot) = fields.remove("shot") else { continue };
            let view = self.shots.iter().position(|(name, _)| shot == name.as_str());
            let view = view.ok_or_else(|| match self.shots.is_empty() {
                true => format!("goal {}: it names shot {shot}; give the list with --shots", number + 1),
                false => format!("goal {}: the list has no shot {shot}", number + 1),
            })?;
            if fields.insert("view".into(), json!(view)).is_some() {
                return Err(format!("goal {}: it names both a shot and a view", number + 1));
            }
        }
        Ok(())
    }
}

/// Names of the shots that goals are about.
fn shots_of_goals(request: &Value) -> Vec<String> {
    let goals = request["goals"].as_array().into_iter().flatten();
    goals.filter_map(|goal| goal["shot"].as_str().map(str::to_owned)).collect()
}

fn json_file(path: &Path) -> anyhow::Result<Value> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_str(&text).map_err(|error| anyhow::anyhow!("request {}: {error}", path.display()))
}

/// A request without lights is about those that the bake's scene came with.
fn read_request(path: &Path, views: &Views, relighter: &Relighter) -> anyhow::Result<SolveRequest> {
    let mut value = json_file(path)?;
    let mut parse = || -> Result<SolveRequest, String> {
        value.get_mut("goals").map_or(Ok(()), |goals| views.number(goals))?;
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
    views: &Views,
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
        "goals": targets(args.target.as_deref(), views),
        "starts": args.starts,
        "steps": args.iterations,
        "pixel_fraction": args.pixel_fraction,
        "polish": args.polish,
        "seed": context.seed(),
    });
    SolveRequest::parse(&request.to_string()).map_err(|reason| anyhow::anyhow!(reason))
}

/// A goal for each shot where `{shot}` stands for its name, else for the first view alone.
fn targets(target: Option<&Path>, views: &Views) -> Value {
    let pattern = target.map(|path| path.to_string_lossy().into_owned()).unwrap_or_default();
    if !pattern.contains(SHOT) {
        return json!([{"goal": "target", "image": target}]);
    }
    let goal = |(view, (_, file)): (usize, &(String, String))| {
        let image = pattern.replace(SHOT, file);
        json!({"goal": "target", "image": image, "view": view})
    };
    views.shots.iter().enumerate().map(goal).collect()
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
