use crate::files::proxies::Proxies;
use relume_scene::{Light, LobeFactors};
use serde::{Deserialize, Serialize};

/// Method that makes the pictures of lights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// For each light the one with the lower measured error; gather without a measured proxy.
    #[default]
    Auto,
    /// Sums over the dump.
    Gather,
    /// Proxies; lights that no proxy covers are gathered.
    Proxy,
}

/// Source of one light's unit image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UnitSource {
    /// Sum over the dump.
    Gather,
    /// Denoised sum over the dump.
    GatherDenoised,
    /// Proxy.
    Proxy,
}

impl UnitSource {
    /// Source by the dump, denoised or as it is.
    pub(crate) fn gathered(denoised: bool) -> Self {
        if denoised { Self::GatherDenoised } else { Self::Gather }
    }

    /// Source of a light's unit image; none if it needs a dump and there is none. `gather` are the paths per pixel of the
    /// dump, whose sums would be `denoised`, and whether the light is connected, which no proxy comes up to.
    pub(crate) fn choose(
        light: &Light,
        method: Method,
        proxies: &Proxies,
        gather: Option<(u32, bool)>,
        denoised: bool,
    ) -> Option<Self> {
        let is_better =
            |samples| proxies.knowing(light).is_some_and(|proxy| proxy.beats_gather(denoised, samples));
        let by_proxy = match (method, gather) {
            (Method::Gather, _) => false,
            (Method::Auto, Some((samples, connected))) => !connected && is_better(samples),
            (Method::Proxy, _) | (Method::Auto, None) => proxies.covering(light).is_some(),
        };
        match by_proxy {
            true => Some(Self::Proxy),
            false => gather.map(|_| Self::gathered(denoised)),
        }
    }
}

/// Part of a light that the camera sees directly, which proxies do not learn.
pub(crate) fn camera_only(light: &Light) -> Light {
    let camera = light.lobes.camera;
    let lobes = LobeFactors { camera, diffuse: 0.0, glossy: 0.0, transmission: 0.0, volume: 0.0 };
    Light { lobes, ..light.clone() }
}
