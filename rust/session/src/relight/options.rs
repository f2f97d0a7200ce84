use crate::relight::film::CatcherPlace;
use crate::relight::source::Method;

/// Options of a relight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelightOptions {
    /// Method that makes the pictures.
    pub method: Method,
    /// True to denoise gathered lights and the static layers; without a denoiser the user is warned.
    pub denoise: bool,
    /// True to part the picture of each light by lobes ([`relume_gather::LobePart`]). Lights are gathered then.
    pub lobes: bool,
}

impl Default for RelightOptions {
    fn default() -> Self {
        Self { method: Method::Auto, denoise: true, lobes: false }
    }
}

/// Factors on light that has no light's weight, and the place of what shadow catchers show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureMix {
    /// Factor on light that the scene itself emits, RGB.
    pub static_light: [f32; 3],
    /// Factor on light of the world, RGB.
    pub world: [f32; 3],
    /// Place of what shadow catchers show.
    pub catcher: CatcherPlace,
}

impl Default for PictureMix {
    fn default() -> Self {
        Self { static_light: [1.0; 3], world: [1.0; 3], catcher: CatcherPlace::Picture }
    }
}
