mod connected;
mod lobes;

use crate::bake::features::camera;
use crate::bake::guiding::{GuideCoverage, GuidingRecord};
use crate::bake::world::{WorldAbout, WorldLayer, aovs_of, own_world};
use crate::device::compute::Compute;
use crate::device::gather::DeviceGather;
use crate::device::image::DeviceImage;
use crate::device::proxies::DeviceProxies;
use crate::error::SessionError;
use crate::files::base_layers;
use crate::files::damage::{damage_message, reason_of};
use crate::files::light_set::LightSet;
use crate::files::names::{GUIDED_FILE, VIEW_FILE, WORLD_FILE};
use crate::files::proxies::Proxies;
use crate::progress::{Monitor, Stage};
use crate::relight::denoise::Denoise;
use crate::relight::film::Film;
use crate::relight::gathered::Gathered;
use crate::relight::notes::LightNotes;
use crate::relight::options::{PictureMix, RelightOptions};
use crate::relight::relit::{Relit, RelitLight};
use crate::relight::source::{UnitSource, camera_only};
use crate::relight::statics::StaticLayer;
use crate::relight::units::{GROUP, UnitCache, UnitImages};
pub use connected::OpenScenes;
use lobes::KeptLobes;
use relume_dump::{Aovs, Dump, Manifest};
use relume_gather::{Environment, Gather};
use relume_image::{Image, ViewTransform};
use relume_proxy::{GpuProxy, LightKind};
use relume_scene::{Camera, Light, Scene, Texture, World};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Turns lights into pictures of all paths, from a bake folder with dump and proxies, or from proxies alone. It keeps each
/// light's unit image, so that another colour, strength or mute is only a new sum.
pub struct Relighter {
    folder: PathBuf,
    scene_hash: String,
    camera: Camera,
    film: Film,
    /// Features and static layers of all plates of the film.
    aovs: Aovs,
    gather: Option<DeviceGather>,
    coverage: Option<GuideCoverage>,
    proxies: DeviceProxies,
    denoise: Denoise,
    compute: Compute,
    units: Mutex<UnitCache>,
    /// Static light and world.
    statics: Mutex<[StaticLayer; 2]>,
    /// The world that is shown; none without a dump.
    world: Option<WorldAbout>,
    /// Files of the folder that could not be used, and what follows, in words for the user.
    damaged: Vec<String>,
    /// Lobes that were made ahead.
    lobes: Mutex<Vec<KeptLobes>>,
}

impl Relighter {
    /// Opens a bake folder, or a folder with proxies and their base layers.
    ///
    /// # Errors
    /// If the folder is neither, or a file is damaged that every picture needs. Other damage is in [`Self::damaged`].
    pub fn open(folder: &Path) -> Result<Self, SessionError> {
        if folder.join(Manifest::FILE).exists() {
            return Self::from_dump(Dump::open(folder)?, folder);
        }
        let base = base_layers::read(folder)?;
        let (proxies, damaged) = Proxies::open_usable(folder, &base.scene_hash);
        if proxies.is_empty() {
            let none = format!("{} holds neither a bake nor a proxy; bake or train first", folder.display());
            return Err(SessionError::Settings(damaged.first().cloned().unwrap_or(none)));
        }
        let new = Self::new(folder, base.scene_hash, base.camera, (Film::PLAIN, base.aovs), None, proxies);
        Ok(Self { damaged, ..new })
    }

    /// Relights from a dump, also one that is still growing, and from the proxies of a folder.
    ///
    /// # Errors
    /// If the dump has no camera.
    pub fn from_dump(dump: Dump, folder: &Path) -> Result<Self, SessionError> {
        let manifest = dump.manifest();
        let (camera, scene_hash) = (camera(manifest)?, manifest.scene_hash.clone());
        let (proxies, mut damaged) = Proxies::open_usable(folder, &scene_hash);
        let mut without =
            |name: &str, error| damaged.push(damage_message(&folder.join(name), &reason_of(error)));
        let world = WorldLayer::of_bake(folder, manifest).unwrap_or_else(|error| {
            without(WORLD_FILE, error);
            None
        });
        let guiding_record = GuidingRecord::of_bake(folder).unwrap_or_else(|error| {
            without(GUIDED_FILE, error);
            GuidingRecord::default()
        });
        let film = Film::of(manifest, &camera)?;
        let (aovs, world) = aovs_of(&dump, world);
        let coverage = GuideCoverage::new(&guiding_record, manifest, &film.features(&aovs), &camera);
        let new = Self::new(folder, scene_hash, camera, (film, aovs), Some(Gather::new(dump)), proxies);
        Ok(Self { coverage: Some(coverage), world: Some(world), damaged, ..new })
    }

    fn new(
        folder: &Path,
        scene_hash: String,
        camera: Camera,
        (film, aovs): (Film, Aovs),
        gather: Option<Gather>,
        proxies: Proxies,
    ) -> Self {
        let denoise = Denoise::new(&film.features(&aovs), None);
        let statics = Mutex::new(StaticLayer::of(&aovs));
        let gather = gather.map(DeviceGather::new);
        gather
            .iter()
            .filter(|gather| gather.gather().dump().missing().is_empty())
            .for_each(DeviceGather::allow_sorting);
        Self {
            folder: folder.to_path_buf(),
            scene_hash,
            camera,
            film,
            aovs,
            gather,
            coverage: None,
            proxies: DeviceProxies::new(proxies),
            denoise,
            compute: Compute::default(),
            units: Mutex::default(),
            statics,
            world: None,
            damaged: Vec::new(),
            lobes: Mutex::default(),
        }
    }

    /// Sets the devices that it runs on.
    #[must_use]
    pub fn on(self, compute: &Compute) -> Self {
        let denoise = Denoise::new(&self.film.features(&self.aovs), compute.gpu.as_deref());
        Self { denoise, compute: compute.clone(), ..self }
    }

    /// The camera that was baked.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// True if its film has shadow catchers, which neither proxies nor solves know.
    pub fn catches_shadows(&self) -> bool {
        self.film.catches()
    }

    /// Per-pixel features and static layers, of all plates of the film one below the other.
    pub fn aovs(&self) -> &Aovs {
        &self.aovs
    }

    /// The dump, if there is one.
    pub fn gather(&self) -> Option<&Gather> {
        self.gather.as_ref().map(DeviceGather::gather)
    }

    /// Dump on the device that gathers from it.
    pub(crate) fn device_gather(&self) -> Option<&DeviceGather> {
        self.gather.as_ref()
    }

    /// Devices that it runs on.
    pub(crate) fn compute(&self) -> &Compute {
        &self.compute
    }

    /// The proxies.
    pub fn proxies(&self) -> &Proxies {
        self.proxies.proxies()
    }

    /// The lights that the scene came with; none if the folder does not hold them.
    ///
    /// # Errors
    /// If their file is damaged.
    pub fn scene_lights(&self) -> Result<LightSet, SessionError> {
        LightSet::of_bake(&self.folder)
    }

    /// Files of the folder that could not be used, and what follows, in words for the user.
    pub fn damaged(&self) -> &[String] {
        &self.damaged
    }

    /// View transform of the scene; the sRGB curve, with a warning, if the folder has none that can be read.
    pub fn view(&self, monitor: &Monitor) -> ViewTransform {
        let path = self.folder.join(VIEW_FILE);
        if !path.exists() {
            return ViewTransform::Standard;
        }
        ViewTransform::read_lut(&path).unwrap_or_else(|error| {
            monitor.warn(&damage_message(&path, &error.to_string()));
            ViewTransform::Standard
        })
    }

    /// Radiance of the world that is shown, or the factor on its texture, RGB; none without a dump. A folder opens with
    /// the world that was shown last.
    pub fn world_color(&self) -> Option<[f32; 3]> {
        self.world.as_ref().map(|world| world.color)
    }

    /// Shows the world of a scene: as traced if the bake has that map, else gathered. A world that differs by strength
    /// and tint alone stays ([`Self::world_color`]).
    ///
    /// # Errors
    /// Fails like [`Self::set_world`].
    pub fn show_world_of(&mut self, scene: &Scene, monitor: &Monitor) -> Result<(), SessionError> {
        let map = scene.world_map();
        if self.world.as_ref().is_some_and(|shown| shown.map == map) {
            return Ok(());
        }
        let own = self.gather().map(Gather::dump).filter(|dump| dump.manifest().world_map == map);
        if let Some((world, about)) = own.map(|dump| (dump.aovs().world, own_world(dump.manifest()))) {
            self.replace_world(world, about);
            return Ok(());
        }
        self.set_world(&scene.world, &scene.textures, monitor)?;
        self.world = Some(WorldAbout { map, color: scene.world.color });
        Ok(())
    }

    /// Replaces the world that is shown by another, gathered from the segments that left the scene.
    ///
    /// # Errors
    /// Without a dump, with a damaged texture, or if the GPU fails that the user asked for.
    pub fn set_world(
        &mut self,
        world: &World,
        textures: &[Texture],
        monitor: &Monitor,
    ) -> Result<(), SessionError> {
        let gather = self.gather.as_ref().ok_or_else(|| {
            let folder = self.folder.display();
            SessionError::Settings(format!(
                "{folder} holds no bake; only a bake can be relit by another world"
            ))
        })?;
        let environment = Environment::new(world, textures)?;
        let image = gather.world_image(&environment, &self.compute, monitor)?;
        self.replace_world(image, WorldAbout { color: world.color, ..WorldAbout::default() });
        Ok(())
    }

    fn replace_world(&mut self, image: Image, about: WorldAbout) {
        self.aovs.world = image;
        self.world = Some(about);
        self.statics = Mutex::new(StaticLayer::of(&self.aovs));
    }

    /// Relights.
    ///
    /// # Errors
    /// If a light needs the dump and there is none, or cannot be gathered, or denoising fails.
    pub fn relight(
        &self,
        lights: &[Light],
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> Result<Relit, SessionError> {
        self.relight_mixed(lights, &PictureMix::default(), options, monitor)
    }

    /// [`Self::relight`] with other weights than 1.
    ///
    /// # Errors
    /// Fails like [`Self::relight`].
    pub fn relight_mixed(
        &self,
        lights: &[Light],
        mix: &PictureMix,
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> Result<Relit, SessionError> {
        let options = &self.usable(options, monitor)?;
        let units = self.unit_images(lights, options, monitor)?;
        let mut lobes = self.lobes(lights, &units, options, monitor)?.into_iter();
        let scaled = |image: &Image, weight: &[f32; 3]| {
            let mut scaled = Image::new(image.width, image.height, 3);
            scaled.add_scaled(image, weight);
            scaled
        };
        let lights = lights.iter().zip(units).map(|(light, (unit, source))| {
            let image = scaled(&unit, &light.radiance);
            let lobes = lobes.next().unwrap_or_default();
            let lobes = lobes.iter().map(|lobe| scaled(lobe, &light.radiance)).collect();
            RelitLight { name: light.name.clone(), image, source, lobes }
        });
        let lights: Vec<RelitLight> = lights.collect();
        let [static_light, world] = self.statics(options.denoise)?;
        let static_light = scaled(&static_light, &mix.static_light);
        let world = scaled(&world, &mix.world);
        let features = self.film.features(&self.aovs);
        let mut relit = Relit {
            lights,
            static_light,
            world,
            albedo: features.albedo.clone(),
            normal: features.normal.clone(),
            depth: features.depth.clone(),
            alpha: self.aovs.alpha.clone(),
            backdrop: None,
            shadow_catcher: None,
            scene_hash: self.scene_hash.clone(),
            samples: self.samples(),
        };
        if self.film.catches() {
            let developed = self.film.develop(relit.combined(), &self.aovs.alpha, mix.catcher);
            let top = |image: &mut Image| *image = self.film.top(std::mem::take(image));
            let of_lights = relit.lights.iter_mut();
            let of_lights =
                of_lights.flat_map(|light| [&mut light.image].into_iter().chain(&mut light.lobes));
            of_lights.chain([&mut relit.static_light, &mut relit.world]).for_each(top);
            relit.alpha = developed.alpha;
            (relit.backdrop, relit.shadow_catcher) = (developed.backdrop, developed.catcher);
        }
        Ok(relit)
    }

    /// Paths per pixel of the bake; 0 without one.
    fn samples(&self) -> u32 {
        self.gather().map_or(0, |gather| gather.dump().manifest().samples())
    }

    /// Static light and world; denoised ones are kept.
    pub(crate) fn statics(&self, denoise: bool) -> Result<[Image; 2], SessionError> {
        if !denoise {
            return Ok([self.aovs.emission.clone(), self.aovs.world.clone()]);
        }
        let mut statics = self.statics.lock().unwrap_or_else(PoisonError::into_inner);
        let [emission, world] = &mut *statics;
        Ok([emission.final_image(&self.denoise)?, world.final_image(&self.denoise)?])
    }

    /// Options without denoising if there is no denoiser, with a warning.
    pub(crate) fn without_missing_denoiser(
        &self,
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> RelightOptions {
        let missing = if options.denoise { self.denoise.missing() } else { None };
        if let Some(reason) = &missing {
            monitor.warn(reason);
        }
        RelightOptions { denoise: options.denoise && missing.is_none(), ..*options }
    }

    /// Unit images of lights and their sources, from the cache or made now.
    pub(crate) fn unit_images(
        &self,
        lights: &[Light],
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> Result<Vec<(Image, UnitSource)>, SessionError> {
        let sources = lights.iter().map(|light| self.source(light, options));
        let sources = sources.collect::<Result<Vec<_>, _>>()?;
        let mut images = self.finished(lights, &sources)?;
        let missing: Vec<usize> = (0..lights.len()).filter(|i| images[*i].is_none()).collect();
        let stage = monitor.stage(Stage::Gather, 0, missing.len() as u64);
        let (proxied, gathered): (Vec<usize>, Vec<usize>) =
            missing.into_iter().partition(|i| sources[*i] == UnitSource::Proxy);
        let views = self.direct_views(proxied.iter().map(|i| &lights[*i]), monitor)?;
        for (i, view) in proxied.into_iter().zip(views) {
            let mut image = self.proxies.unit_image(&lights[i], &self.compute, monitor)?;
            view.iter().for_each(|view| image.add_scaled(view, &[1.0; 3]));
            self.cache(&lights[i], |unit| unit.keep_proxy(image.clone()));
            images[i] = Some(image);
            stage.advance(1, &lights[i].name);
        }
        for group in gathered.chunks(GROUP) {
            if monitor.cancelled() {
                return Err(SessionError::Cancelled);
            }
            let group_lights: Vec<Light> = group.iter().map(|i| lights[*i].clone()).collect();
            self.warn_of(&group_lights, monitor);
            for (i, image) in group.iter().zip(self.gather_units(&group_lights, options.denoise, monitor)?) {
                images[*i] = Some(image);
                stage.advance(1, &lights[*i].name);
            }
        }
        Ok(images.into_iter().flatten().zip(sources).collect())
    }

    /// Unit images that are cached.
    fn finished(&self, lights: &[Light], sources: &[UnitSource]) -> Result<Vec<Option<Image>>, SessionError> {
        let mut units = self.units();
        let images = lights.iter().zip(sources).map(|(light, source)| units.finished(light, *source));
        Ok(images.collect::<Result<_, _>>()?)
    }

    /// Gathers unit images and caches them. Not under the lock: a thread that waits for parts of a gather may take up another.
    fn gather_units(
        &self,
        lights: &[Light],
        denoise: bool,
        monitor: &Monitor,
    ) -> Result<Vec<Image>, SessionError> {
        let denoise = denoise.then_some(&self.denoise);
        let mut images = Vec::with_capacity(lights.len());
        for (light, image) in lights.iter().zip(self.gather_images(lights, monitor)?) {
            let mut gathered = Gathered::default();
            gathered.add(DeviceImage::Cpu(image).into(), self.samples())?;
            images.push(gathered.final_image(denoise)?);
            if denoise.is_some() {
                gathered.drop_noisy();
            }
            self.cache(light, |unit| unit.gathered = gathered);
        }
        Ok(images)
    }

    fn cache(&self, light: &Light, change: impl FnOnce(&mut UnitImages)) {
        let mut units = self.units();
        change(units.of(light));
        units.trim(std::slice::from_ref(light), 1);
    }

    /// Direct camera views of lights, which proxies do not learn. None for lights that the camera does not see, or
    /// without a dump.
    fn direct_views<'a>(
        &self,
        lights: impl Iterator<Item = &'a Light>,
        monitor: &Monitor,
    ) -> Result<Vec<Option<Image>>, SessionError> {
        let lights: Vec<&Light> = lights.collect();
        let seen = || lights.iter().copied().filter(|light| light.lobes.camera != 0.0);
        if self.gather.is_none() {
            for light in seen() {
                monitor.warn(&format!(
                    "light '{}' itself is not shown, only its light: that needs the bake",
                    light.name
                ));
            }
            return Ok(vec![None; lights.len()]);
        }
        let views: Vec<Light> = seen().map(camera_only).collect();
        let mut views = self.gather_images(&views, monitor)?.into_iter();
        let view = |light: &&Light| if light.lobes.camera != 0.0 { views.next() } else { None };
        Ok(lights.iter().map(view).collect())
    }

    /// Warns of lights whose gathered pictures are to be trusted less.
    pub(crate) fn warn_of(&self, lights: &[Light], monitor: &Monitor) {
        let Some(gather) = &self.gather else { return };
        let mut notes = LightNotes::default();
        lights.iter().for_each(|light| notes.add_gathered(light, gather, self.coverage.as_ref()));
        notes.warnings.iter().for_each(|text| monitor.warn(text));
    }

    fn source(&self, light: &Light, options: &RelightOptions) -> Result<UnitSource, SessionError> {
        let samples = self.gather.as_ref().map(DeviceGather::samples);
        let gather = samples.map(|samples| (samples, self.connects(light)));
        let source = UnitSource::choose(light, options.method, self.proxies(), gather, options.denoise);
        source.ok_or_else(|| {
            SessionError::Settings(format!(
                "light '{}' is of a type, size or visibility that no proxy in {} covers; relight from its bake",
                light.name,
                self.folder.display()
            ))
        })
    }

    fn units(&self) -> MutexGuard<'_, UnitCache> {
        self.units.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs work with a proxy on the GPU; none if there is no such proxy or the CPU has to do it.
    pub(crate) fn on_gpu_proxy<R>(
        &self,
        kind: LightKind,
        monitor: &Monitor,
        work: impl Fn(&GpuProxy) -> Result<R, SessionError>,
    ) -> Result<Option<R>, SessionError> {
        self.proxies.attempt(kind, &self.compute, monitor, work)
    }

    /// Unit images by the dump, without the cache; none without a dump.
    pub(crate) fn gather_images(
        &self,
        lights: &[Light],
        monitor: &Monitor,
    ) -> Result<Vec<Image>, SessionError> {
        match &self.gather {
            Some(gather) => gather.unit_images(lights, &self.compute, monitor),
            None => Ok(Vec::new()),
        }
    }
}
