use super::view::BakeView;
use crate::bake::world::{WorldAbout, WorldLayer};
use crate::device::compute::Compute;
use crate::device::image::DeviceImage;
use crate::error::SessionError;
use crate::progress::Monitor;
use crate::relight::gathered::Gathered;
use relume_gather::{DenoiseQuality, Environment};
use relume_image::Image;
use relume_scene::{Scene, Texture, World};
use std::path::Path;
use std::sync::Arc;

/// A world that may be shown in place of the one that the paths were traced with.
#[derive(Debug)]
pub struct OtherWorld {
    about: WorldAbout,
    source: WorldSource,
}

#[derive(Debug)]
enum WorldSource {
    /// Map to be gathered from the paths, with the digest of its texture.
    Map(Environment, Option<String>),
    /// Maps of a world with parts, to be gathered from the paths.
    Parts(Environment),
    /// Light that was gathered before.
    Layer(Box<WorldLayer>),
}

impl OtherWorld {
    /// The world of a scene. Takes its time with a large map.
    ///
    /// # Errors
    /// If its texture is damaged.
    pub fn new(scene: &Scene) -> Result<Self, SessionError> {
        let environment = Environment::new(&scene.world, &scene.textures)?;
        if !scene.world.parts.is_empty() {
            let about = WorldAbout { map: scene.world_map(), color: scene.world.color };
            return Ok(Self { about, source: WorldSource::Parts(environment) });
        }
        let texture = scene.world_texture().map(Texture::digest);
        Ok(Self::mapped(&scene.world, environment, texture))
    }

    /// World with the same texture, which is not read again, such as a turned one. The texture that `world` names is
    /// ignored. None for a world whose light lies in a bake folder, or with parts.
    pub fn with_texture_for(&self, world: &World) -> Option<Self> {
        match &self.source {
            WorldSource::Map(environment, texture) if world.parts.is_empty() => {
                Some(Self::mapped(world, environment.with_texture_for(world), texture.clone()))
            }
            _ => None,
        }
    }

    fn mapped(world: &World, environment: Environment, texture: Option<String>) -> Self {
        let about = WorldAbout { map: world.map(texture.as_deref()), color: world.color };
        Self { about, source: WorldSource::Map(environment, texture) }
    }

    /// One whose light lies in a bake folder.
    pub(super) fn stored(layer: WorldLayer) -> Self {
        Self { about: layer.about.clone(), source: WorldSource::Layer(Box::new(layer)) }
    }

    /// Identity of the world.
    pub fn about(&self) -> &WorldAbout {
        &self.about
    }

    /// True if its light lies in the bake folder already.
    pub(super) fn is_stored(&self) -> bool {
        matches!(self.source, WorldSource::Layer(_))
    }

    fn is_black(&self) -> bool {
        self.about.color == [0.0; 3] && !matches!(self.source, WorldSource::Parts(_))
    }
}

/// The light of another world along the passes of a view.
pub(super) struct WorldUnit {
    world: Arc<OtherWorld>,
    /// Identity of the bake that the passes are of.
    bake: String,
    pub gathered: Gathered,
    /// Paths per pixel behind what lies in the bake folder.
    stored_samples: u32,
}

impl WorldUnit {
    /// Unit of a world; sums along the same bake are kept.
    pub fn of(world: Arc<OtherWorld>, view: &BakeView, before: Option<Self>) -> Self {
        let is_same = |before: &Self| Arc::ptr_eq(&before.world, &world) && before.bake == view.bake;
        if let Some(before) = before.filter(is_same) {
            return before;
        }
        let mut unit =
            Self { world, bake: view.bake.clone(), gathered: Gathered::default(), stored_samples: 0 };
        if let WorldSource::Layer(layer) = &unit.world.source {
            let [mean, error] = [&layer.image, &layer.error].map(|image| DeviceImage::Cpu(image.clone()));
            let (passes, samples) = (view.passes.len(), layer.samples);
            unit.gathered = Gathered { mean, error, passes, samples, ..Gathered::default() };
            unit.stored_samples = samples;
        }
        unit
    }

    /// True if it gives no light.
    pub fn is_black(&self) -> bool {
        self.world.is_black()
    }

    /// True if the sum is denoised at this quality, or need not be.
    pub fn is_done(&self, quality: DenoiseQuality) -> bool {
        self.is_black() || self.gathered.is_done(quality)
    }

    /// Gathers one more pass; false if none is left.
    pub fn advance(
        &mut self,
        view: &BakeView,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<bool, SessionError> {
        let environment = match &self.world.source {
            WorldSource::Map(environment, _) | WorldSource::Parts(environment) => environment,
            WorldSource::Layer(_) => return Ok(false),
        };
        let Some(pass) = view.passes.get(self.gathered.passes) else { return Ok(false) };
        let image = if self.is_black() {
            Image::new(view.aovs.alpha.width, view.aovs.alpha.height, 3)
        } else {
            pass.world_image(environment, compute, monitor)?
        };
        self.gathered.add(DeviceImage::Cpu(image).into(), pass.samples())?;
        Ok(true)
    }

    /// Writes the sum into the bake folder, if it has more samples than there. True if it lies there now.
    pub fn store(&mut self, view: &BakeView, folder: &Path) -> Result<bool, SessionError> {
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

    /// True if this world is to be shown.
    pub fn is_of(&self, world: Option<&Arc<OtherWorld>>) -> bool {
        world.is_some_and(|world| Arc::ptr_eq(world, &self.world))
    }
}
