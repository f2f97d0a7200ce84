use crate::error::SessionError;
use crate::files::damage::damage_message;
use crate::files::names::{measured_path, proxy_path};
use relume_proxy::{LightKind, Proxy};
use relume_scene::Light;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Mean errors over some lights, against independent gathers of the other half of the paths.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeanQuality {
    /// dB, tonemapped ([`relume_image::metrics::psnr_reinhard`]).
    pub psnr: f64,
    /// [`relume_image::metrics::smape`].
    pub smape: f64,
    /// [`relume_image::metrics::ssim`], tonemapped.
    pub ssim: f64,
    /// [`relume_image::metrics::flip`], tonemapped.
    pub flip: f64,
}

/// Errors of a proxy and of gathering as many samples, on the same held-out lights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Held-out lights.
    pub lights: usize,
    /// Paths per pixel of the gathers that were compared.
    pub samples: u32,
    /// Seconds that the training was given, if it was limited by time.
    #[serde(default)]
    pub seconds: Option<f64>,
    /// The proxy.
    pub proxy: MeanQuality,
    /// Gathering.
    pub gather: MeanQuality,
    /// Gathering and denoising.
    pub gather_denoised: MeanQuality,
}

/// A proxy and how it was measured.
pub struct TrainedProxy {
    /// The proxy.
    pub proxy: Proxy,
    /// The comparison at the end of its training, if there was one.
    pub measured: Option<Measured>,
}

impl TrainedProxy {
    /// A proxy without its measurement; none if the folder has none of this kind.
    pub(crate) fn open(
        folder: &Path,
        kind: LightKind,
        scene_hash: &str,
    ) -> Result<Option<Self>, SessionError> {
        let path = proxy_path(folder, kind);
        if !path.exists() {
            return Ok(None);
        }
        let proxy = Proxy::open(&path)?;
        if proxy.info().scene_hash != scene_hash {
            let reason = format!("{} is of another scene; train it again on this bake", path.display());
            return Err(SessionError::Settings(reason));
        }
        Ok(Some(Self { proxy, measured: None }))
    }

    /// True if its measured error is below that of gathering so many paths per pixel. The latter falls with the root of
    /// their number. Unmeasured proxies do not beat anything.
    pub fn beats_gather(&self, denoised: bool, samples: u32) -> bool {
        self.measured.is_some_and(|m| {
            let gather = if denoised { m.gather_denoised } else { m.gather };
            m.proxy.smape < gather.smape * (f64::from(m.samples) / f64::from(samples.max(1))).sqrt()
        })
    }
}

/// The proxies of a folder, at most one for each kind of light.
#[derive(Default)]
pub struct Proxies {
    list: Vec<TrainedProxy>,
}

impl Proxies {
    /// Opens all proxies of a folder that are of this scene; says what is wrong with others, and with measurements.
    pub fn open_usable(folder: &Path, scene_hash: &str) -> (Self, Vec<String>) {
        let (mut list, mut unusable) = (Vec::new(), Vec::new());
        for kind in LightKind::ALL {
            match TrainedProxy::open(folder, kind, scene_hash) {
                Ok(None) => {}
                Ok(Some(trained)) => {
                    let path = measured_path(folder, kind);
                    let measured = read_measured(&path).unwrap_or_else(|reason| {
                        unusable.push(damage_message(&path, &reason));
                        None
                    });
                    list.push(TrainedProxy { measured, ..trained });
                }
                Err(error) => unusable.push(error.to_string()),
            }
        }
        (Self { list }, unusable)
    }

    /// True without any proxy.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Iterates over all proxies.
    pub fn iter(&self) -> impl Iterator<Item = &TrainedProxy> {
        self.list.iter()
    }

    /// The proxy for a kind of light.
    pub fn of(&self, kind: LightKind) -> Option<&TrainedProxy> {
        self.list.iter().find(|trained| trained.proxy.info().kind == kind)
    }

    /// Proxy for a light: of the kind that answers for it ([`LightKind::answering`]), and of its size. It lacks the direct view
    /// of a light that the camera sees.
    pub fn covering(&self, light: &Light) -> Option<&TrainedProxy> {
        self.of(LightKind::answering(light)?).filter(|trained| trained.proxy.covers(&light.shape))
    }

    /// [`Proxies::covering`] if the light is in a place that the proxy has learned; elsewhere it extrapolates.
    pub fn knowing(&self, light: &Light) -> Option<&TrainedProxy> {
        self.covering(light).filter(|trained| trained.proxy.has_learned_place(&light.shape))
    }
}

/// The measurement of a file, if it is there; else why it cannot be read.
pub(crate) fn read_measured(path: &Path) -> Result<Option<Measured>, String> {
    if !path.exists() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(path).map_err(|error| error.to_string())?;
    serde_json::from_str(&text).map(Some).map_err(|error| error.to_string())
}
