use super::LiveRequest;
use super::view::View;
use crate::files::proxies::Proxies;
use crate::relight::relighter::{With, camera_only, too_small};
use relume_proxy::LightKind;
use relume_scene::Light;

/// A part of the picture: a light as it is shown.
pub(super) struct Part {
    pub light: Light,
    pub how: How,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum How {
    /// Summed over the paths.
    Gather,
    /// By a proxy.
    Proxy,
    /// The light itself as the camera sees it, summed over the paths.
    View,
    /// The same of a light whose own sum is to come, of the first pass: for as long as its proxy, which knows nothing of it, stands
    /// in for the next part.
    Glimpse,
}

/// What there is to say about the lights of a request.
#[derive(Default)]
pub(super) struct Told {
    pub warnings: Vec<String>,
    /// Names of those that new paths would meet, while those of the bake hardly do.
    pub rarely_met: Vec<String>,
}

/// The lights that give light, each with what shows it, and what there is to say about them.
pub(super) fn parts(request: &LiveRequest, view: &mut View) -> (Vec<Part>, Told) {
    let (mut parts, mut told) = (Vec::new(), Told { warnings: request.notes.clone(), ..Told::default() });
    let mut unlearned = Vec::new();
    for light in request.lights.iter().filter(|light| light.radiance != [0.0; 3]) {
        match part(light, request.with, view, &mut told.warnings) {
            Ok(how) => {
                if how == How::Gather && !has_proxy(light, view.proxies.proxies()) {
                    unlearned.push(light.name.as_str());
                }
                let pass = view.passes.first().filter(|_| how == How::Gather);
                told.warnings.extend(pass.and_then(|pass| too_small(pass.gather(), light)));
                if let (How::Gather, Some(rare)) = (how, view.rare(light)) {
                    told.warnings.push(rare.warning(light));
                    told.rarely_met.extend(rare.would_be_met.then(|| light.name.clone()));
                }
                let seen = match how {
                    How::Proxy => Some(How::View),
                    _ if request.with == With::Gather => None,
                    _ => view.proxies.proxies().knowing(light).map(|_| How::Glimpse),
                };
                if let Some(how) = seen.filter(|_| light.lobes.camera != 0.0 && !view.passes.is_empty()) {
                    parts.push(Part { light: camera_only(light), how });
                }
                parts.push(Part { light: light.clone(), how });
            }
            Err(reason) => told.warnings.push(reason),
        }
    }
    if !view.proxies.proxies().is_empty() {
        told.warnings.extend(without_proxy(&unlearned));
    }
    (parts, told)
}

/// Whether lights of its kind have been learned.
fn has_proxy(light: &Light, proxies: &Proxies) -> bool {
    LightKind::of(&light.shape).is_some_and(|kind| proxies.of(kind).is_some())
}

/// What to say of lights that are slower to drag than those of other kinds.
fn without_proxy(names: &[&str]) -> Option<String> {
    let named = match names {
        [] => return None,
        [one] => format!("'{one}'"),
        [one, other] => format!("'{one}' and '{other}'"),
        [one, other, more @ ..] => format!("'{one}', '{other}' and {} more", more.len()),
    };
    Some(format!(
        "no proxy has learned lights such as {named} (only points, and rectangles of full spread, ever are): they are \
         summed from the samples, which is slower"
    ))
}

fn part(light: &Light, with: With, view: &View, warnings: &mut Vec<String>) -> Result<How, String> {
    let proxies = view.proxies.proxies();
    let pass = view.passes.first();
    let covering = proxies.covering(light);
    if covering.is_some() && (with == With::Proxy || pass.is_none()) {
        let guess = format!(
            "light '{}' is outside of where its proxy has learned; what it shows is a guess",
            light.name
        );
        warnings.extend(proxies.knowing(light).is_none().then_some(guess));
        return Ok(How::Proxy);
    }
    let Some(pass) = pass else {
        return Err(format!("light '{}': no proxy covers it, and there is no bake", light.name));
    };
    if with == With::Auto
        && proxies.knowing(light).is_some_and(|proxy| proxy.beats_gather(true, view.samples()))
    {
        return Ok(How::Proxy);
    }
    pass.gather().prepare(light).map_err(|error| error.to_string())?;
    warnings.extend(outside_of_training(light, proxies));
    Ok(How::Gather)
}

/// What to say of a light whose kind has a proxy that does not know it.
fn outside_of_training(light: &Light, proxies: &Proxies) -> Option<String> {
    let info = proxies.of(LightKind::of(&light.shape)?)?.proxy.info();
    if proxies.knowing(light).is_some() {
        return None;
    }
    let reason = if proxies.covering(light).is_none() {
        let (min, max) = (info.size.min, info.size.max);
        format!("sizes of {min:.2} to {max:.2} m, usual ray visibility, no light linking")
    } else {
        let range = |axis: usize| {
            let [least, greatest] = info.trained_ranges[axis];
            format!("{least:.2} to {greatest:.2}")
        };
        format!("places of x {}, y {}, z {} m", range(0), range(1), range(2))
    };
    Some(format!(
        "light '{}' is not among what its proxy has learned ({reason}); it is summed from the samples, which is slower",
        light.name
    ))
}
