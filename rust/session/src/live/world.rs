use super::gathered::Gathered;
use super::view::{View, pass_samples};
use crate::bake::world::{WorldAbout, WorldLayer};
use crate::device::compute::Compute;
use crate::device::image::DeviceImage;
use crate::error::SessionError;
use crate::progress::Monitor;
use relume_gather::{DenoiseQuality, Environment};
use relume_image::Image;
use relume_scene::{Scene, Texture, World};
use std::path::Path;
use std::sync::Arc;

/// A world that may be shown in place of the one that the paths were traced with.
#[derive(Debug)]
pub struct OtherWorld {
    about: WorldAbout,
    source: Source,
}

#[derive(Debug)]
enum Source {
    /// To be gathered from the paths; with the digest of its texture.
    Map(Environment, Option<String>),
    /// Gathered before.
    Layer(Box<WorldLayer>),
}

impl OtherWorld {
    /// The world of a scene. Takes its time with a large map.
    ///
    /// # Errors
    /// If its texture is damaged.
    pub fn new(scene: &Scene) -> Result<Self, SessionError> {
        let texture = scene.world_texture().map(Texture::digest);
        let environment = Environment::new(&scene.world, &scene.textures)?;
        Ok(Self::mapped(&scene.world, environment, texture))
    }

    /// Another world of the same texture, such as one that was turned: nothing of that is read again. The texture that
    /// `world` itself names is not looked at. None of a world whose light lies in a bake folder.
    pub fn with_texture_for(&self, world: &World) -> Option<Self> {
        match &self.source {
            Source::Map(environment, texture) => {
                Some(Self::mapped(world, environment.with_texture_for(world), texture.clone()))
            }
            Source::Layer(_) => None,
        }
    }

    fn mapped(world: &World, environment: Environment, texture: Option<String>) -> Self {
        let about = WorldAbout { map: world.map(texture.as_deref()), color: world.color };
        Self { about, source: Source::Map(environment, texture) }
    }

    /// One whose light lies in a bake folder.
    pub(super) fn stored(layer: WorldLayer) -> Self {
        Self { about: layer.about.clone(), source: Source::Layer(Box::new(layer)) }
    }

    /// Which one it is.
    pub fn about(&self) -> &WorldAbout {
        &self.about
    }

    /// Whether its light lies in the bake folder already.
    pub(super) fn is_stored(&self) -> bool {
        matches!(self.source, Source::Layer(_))
    }

    fn is_black(&self) -> bool {
        self.about.color == [0.0; 3]
    }
}

/// The light of another world along the passes of a view.
pub(super) struct WorldUnit {
    world: Arc<OtherWorld>,
    /// Which bake the passes are of.
    bake: String,
    pub gathered: Gathered,
    /// Paths per pixel behind what lies in the bake folder.
    stored_samples: u32,
}

impl WorldUnit {
    /// What there is to show of a world; what was gathered of the same along the same bake stays.
    pub fn of(world: Arc<OtherWorld>, view: &View, before: Option<Self>) -> Self {
        let is_same = |before: &Self| Arc::ptr_eq(&before.world, &world) && before.bake == view.bake;
        if let Some(before) = before.filter(is_same) {
            return before;
        }
        let mut unit =
            Self { world, bake: view.bake.clone(), gathered: Gathered::default(), stored_samples: 0 };
        if let Source::Layer(layer) = &unit.world.source {
            let [mean, error] = [&layer.image, &layer.error].map(|image| DeviceImage::Cpu(image.clone()));
            let (passes, samples) = (view.passes.len(), layer.samples);
            unit.gathered = Gathered { mean, error, passes, samples, clean: None };
            unit.stored_samples = samples;
        }
        unit
    }

    /// Whether it gives any light.
    pub fn is_black(&self) -> bool {
        self.world.is_black()
    }

    /// Whether what was gathered is denoised as well as that, or need not be.
    pub fn is_done(&self, quality: DenoiseQuality) -> bool {
        self.is_black() || self.gathered.is_done(quality)
    }

    /// Gathers one more pass; false if none is left.
    pub fn advance(
        &mut self,
        view: &View,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<bool, SessionError> {
        let (Source::Map(environment, _), Some(pass)) =
            (&self.world.source, view.passes.get(self.gathered.passes))
        else {
            return Ok(false);
        };
        let image = if self.is_black() {
            Image::new(view.aovs.alpha.width, view.aovs.alpha.height, 3)
        } else {
            pass.world_image(environment, compute, monitor)?
        };
        self.gathered.add(DeviceImage::Cpu(image), pass_samples(pass))?;
        Ok(true)
    }

    /// Writes what was gathered into the bake's folder, if that is more than lies there. Whether it lies there now.
    pub fn store(&mut self, view: &View, folder: &Path) -> Result<bool, SessionError> {
        let Some(pass) = view.passes.first().filter(|_| self.gathered.passes > 0) else { return Ok(false) };
        if self.gathered.samples > self.stored_samples {
            let (image, error) = (self.gathered.mean.read()?, self.gathered.error.read()?);
            let (about, samples) = (self.world.about.clone(), self.gathered.samples);
            let layer = WorldLayer { about, samples, image, error };
            layer.write(folder, pass.gather().dump().manifest())?;
            self.stored_samples = samples;
        }
        Ok(true)
    }

    /// Whether this is what is to be shown.
    pub fn is_of(&self, world: Option<&Arc<OtherWorld>>) -> bool {
        world.is_some_and(|world| Arc::ptr_eq(world, &self.world))
    }
}
