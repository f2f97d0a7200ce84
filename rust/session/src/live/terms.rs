use super::LiveRequest;
use super::view::BakeView;
use crate::files::proxies::Proxies;
use crate::relight::notes::{LightNotes, extrapolated, outside_of_training, without_proxy};
use crate::relight::source::{Method, UnitSource, camera_only};
use relume_proxy::LightKind;
use relume_scene::Light;

/// Term of the sum that a frame is: a light, or a part of it.
pub(super) struct LightTerm {
    pub light: Light,
    pub source: TermSource,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum TermSource {
    /// Sum over the paths.
    Gather,
    /// Proxy.
    Proxy,
    /// Direct camera view of a light whose proxy is the next term, summed over the paths.
    DirectView,
    /// Direct camera view from the first pass only. It is shown while a proxy, which lacks it, stands in for the next term.
    FirstView,
}

/// Terms of all lights that shine, and notes on those.
pub(super) fn light_terms(request: &LiveRequest, view: &BakeView) -> (Vec<LightTerm>, LightNotes) {
    let (proxies, first_pass) = (view.proxies.proxies(), view.passes.first());
    let mut notes = LightNotes { warnings: request.notes.clone(), ..LightNotes::default() };
    let (mut terms, mut unlearned) = (Vec::new(), Vec::new());
    for light in request.lights.iter().filter(|light| light.radiance != [0.0; 3]) {
        let source = match source(light, request.method, view) {
            Ok(source) => source,
            Err(reason) => {
                notes.warnings.push(reason);
                continue;
            }
        };
        match first_pass.filter(|_| source == TermSource::Gather) {
            Some(pass) => {
                notes.warnings.extend(outside_of_training(light, proxies));
                notes.add_gathered(light, pass, view.coverage.as_ref());
                unlearned.extend((!has_proxy(light, proxies)).then_some(light.name.as_str()));
            }
            None => notes.warnings.extend(extrapolated(light, proxies)),
        }
        let direct = match source {
            TermSource::Proxy => Some(TermSource::DirectView),
            _ if request.method == Method::Gather => None,
            _ => proxies.knowing(light).map(|_| TermSource::FirstView),
        };
        if let Some(source) = direct.filter(|_| light.lobes.camera != 0.0 && first_pass.is_some()) {
            terms.push(LightTerm { light: camera_only(light), source });
        }
        terms.push(LightTerm { light: light.clone(), source });
    }
    if !proxies.is_empty() {
        notes.warnings.extend(without_proxy(&unlearned));
    }
    (terms, notes)
}

/// True if lights of its kind have been learned.
fn has_proxy(light: &Light, proxies: &Proxies) -> bool {
    LightKind::of_light(light).is_some_and(|kind| proxies.of(kind).is_some())
}

fn source(light: &Light, method: Method, view: &BakeView) -> Result<TermSource, String> {
    let pass = view.passes.first();
    // Without paths there are only proxies.
    let method = if pass.is_some() { method } else { Method::Auto };
    let gather = pass.map(|pass| (view.samples(), pass.connects(light)));
    match (UnitSource::choose(light, method, view.proxies.proxies(), gather, true), pass) {
        (Some(UnitSource::Proxy), _) => Ok(TermSource::Proxy),
        (Some(_), Some(pass)) => {
            pass.gather().prepare(light).map_err(|error| error.to_string())?;
            Ok(TermSource::Gather)
        }
        _ => Err(format!("light '{}': no proxy covers it, and there is no bake", light.name)),
    }
}
