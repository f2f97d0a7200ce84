use crate::bake::features::camera;
use crate::bake::guiding::{Guided, Sight};
use crate::bake::world::{WorldAbout, WorldLayer, aovs_of, own_world};
use crate::device::compute::Compute;
use crate::device::gather::DeviceGather;
use crate::device::proxies::DeviceProxies;
use crate::error::SessionError;
use crate::files::base_layers;
use crate::files::damage::{reason_of, words};
use crate::files::light_set::LightSet;
use crate::files::names::{GUIDED_FILE, VIEW_FILE, WORLD_FILE};
use crate::files::proxies::Proxies;
use crate::progress::{Monitor, Stage};
use crate::relight::denoise::Denoise;
use crate::relight::relit::{Relit, RelitLight};
use crate::relight::unit_cache::UnitCache;
use relume_dump::{Aovs, Dump, Manifest};
use relume_gather::{DenoiseQuality, Environment, Gather, SampleSplit};
use relume_image::{Image, ViewTransform};
use relume_proxy::{GpuProxy, LightKind};
use relume_scene::{Camera, Light, LobeFactors, Scene, Texture, World};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// What makes a light's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum With {
    /// For each type of light whichever had the lower error when the proxy was measured; gather where there is no proxy.
    #[default]
    Auto,
    /// The dump.
    Gather,
    /// The proxy; lights that no proxy covers are gathered.
    Proxy,
}

/// How to relight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelightOptions {
    /// What makes the pictures.
    pub with: With,
    /// Denoise what is gathered, and the static layers; without a denoiser it is a warning.
    pub denoise: bool,
}

impl Default for RelightOptions {
    fn default() -> Self {
        Self { with: With::Auto, denoise: true }
    }
}

/// What a picture of a light was made by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Maker {
    /// Summed over the dump.
    Gather,
    /// Summed over the dump and denoised.
    GatherDenoised,
    /// A proxy.
    Proxy,
}

/// Turns lights into pictures: from a bake folder with its dump and proxies, or from proxies alone. Keeps each light's
/// unit image, so that colour, strength and mute only sum anew.
pub struct Relighter {
    folder: PathBuf,
    scene_hash: String,
    camera: Camera,
    aovs: Aovs,
    gather: Option<DeviceGather>,
    sight: Option<Sight>,
    proxies: DeviceProxies,
    denoise: Denoise,
    compute: Compute,
    cache: UnitCache,
    clean_statics: OnceLock<[Image; 2]>,
    /// The world that is shown; none without a dump.
    world: Option<WorldAbout>,
    /// Files of the folder that could not be used, and what follows, in words for the user.
    damaged: Vec<String>,
}

impl Relighter {
    /// Opens a bake folder, or a folder with proxies and their base layers.
    ///
    /// # Errors
    /// If the folder is neither, or a file in it is damaged that pictures are made of; others are [`Self::damaged`].
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
        let new = Self::new(folder, base.scene_hash, base.camera, base.aovs, None, proxies);
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
        let mut without = |name: &str, error| damaged.push(words(&folder.join(name), &reason_of(error)));
        let world = WorldLayer::of_bake(folder, manifest).unwrap_or_else(|error| {
            without(WORLD_FILE, error);
            None
        });
        let guided = Guided::of_bake(folder).unwrap_or_else(|error| {
            without(GUIDED_FILE, error);
            Guided::default()
        });
        let (aovs, world) = aovs_of(&dump, world);
        let sight = Sight::new(&guided, manifest, &aovs, &camera);
        let new = Self::new(folder, scene_hash, camera, aovs, Some(Gather::new(dump)), proxies);
        Ok(Self { sight: Some(sight), world: Some(world), damaged, ..new })
    }

    fn new(
        folder: &Path,
        scene_hash: String,
        camera: Camera,
        aovs: Aovs,
        gather: Option<Gather>,
        proxies: Proxies,
    ) -> Self {
        let denoise = Denoise::new(&aovs, None);
        let cache = UnitCache::default();
        let gather = gather.map(DeviceGather::new);
        gather
            .iter()
            .filter(|gather| gather.gather().dump().missing().is_empty())
            .for_each(DeviceGather::allow_sorting);
        Self {
            folder: folder.to_path_buf(),
            scene_hash,
            camera,
            aovs,
            gather,
            sight: None,
            proxies: DeviceProxies::new(proxies),
            denoise,
            compute: Compute::default(),
            cache,
            clean_statics: OnceLock::new(),
            world: None,
            damaged: Vec::new(),
        }
    }

    /// Lets this device do what it can.
    #[must_use]
    pub fn on(self, compute: &Compute) -> Self {
        let denoise = Denoise::new(&self.aovs, compute.gpu.as_deref());
        Self { denoise, compute: compute.clone(), ..self }
    }

    /// The camera that was baked.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Per-pixel features and static layers.
    pub fn aovs(&self) -> &Aovs {
        &self.aovs
    }

    /// The dump, if there is one.
    pub fn gather(&self) -> Option<&Gather> {
        self.gather.as_ref().map(DeviceGather::gather)
    }

    /// The dump where it is gathered from.
    pub(crate) fn device_gather(&self) -> Option<&DeviceGather> {
        self.gather.as_ref()
    }

    /// Whether hardly any path of the bake meets a light, so that its gathered picture is noise, while new paths would meet it that
    /// look for it ([`relume_trace::TraceSettings::guide_targets`]).
    pub fn misses(&self, light: &Light) -> bool {
        let rare = self.sight.as_ref().and_then(|sight| sight.rare(light));
        rare.is_some_and(|rare| rare.would_be_met)
    }

    /// Those of some lights whose pictures would be gathered from paths that hardly meet them ([`Self::misses`]).
    pub fn rarely_met<'a>(&self, lights: &'a [Light]) -> Vec<&'a Light> {
        let maker = |light: &Light| self.maker(light, &RelightOptions::default());
        let is_gathered = |light: &Light| matches!(maker(light), Ok(Maker::GatherDenoised));
        lights.iter().filter(|light| is_gathered(light) && self.misses(light)).collect()
    }

    /// What does it.
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

    /// The scene's view transform; the sRGB curve if the folder holds none, or none that can be read, which the user is told.
    pub fn view(&self, monitor: &Monitor) -> ViewTransform {
        let path = self.folder.join(VIEW_FILE);
        if !path.exists() {
            return ViewTransform::Standard;
        }
        ViewTransform::read_lut(&path).unwrap_or_else(|error| {
            monitor.warn(&words(&path, &error.to_string()));
            ViewTransform::Standard
        })
    }

    /// Radiance of the world that is shown, or the factor on its texture, RGB; none without a dump. Opened is the one that was shown
    /// last of the bake.
    pub fn world_color(&self) -> Option<[f32; 3]> {
        self.world.as_ref().map(|world| world.color)
    }

    /// Shows a scene's world: the bake's own as it was traced, and any other gathered, if the one that is shown differs by more than
    /// strength and tint ([`Self::world_color`]).
    ///
    /// # Errors
    /// As [`Self::set_world`].
    pub fn show_world_of(&mut self, scene: &Scene, monitor: &Monitor) -> Result<(), SessionError> {
        let map = scene.world_map();
        if self.world.as_ref().is_some_and(|shown| shown.map == map) {
            return Ok(());
        }
        let own = self.gather().map(Gather::dump).filter(|dump| dump.manifest().world_map == map);
        if let Some((world, about)) = own.map(|dump| (dump.aovs().world, own_world(dump.manifest()))) {
            self.aovs.world = world;
            self.world = Some(about);
            self.clean_statics = OnceLock::new();
            return Ok(());
        }
        self.set_world(&scene.world, &scene.textures, monitor)?;
        self.world = Some(WorldAbout { map, color: scene.world.color });
        Ok(())
    }

    /// Replaces the world that is shown by another, gathered from the segments that left the scene.
    ///
    /// # Errors
    /// Without a dump, if the world's texture is damaged, or if the GPU fails that the user asked for.
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
        self.aovs.world = gather.world_image(&environment, &self.compute, monitor)?;
        self.world = Some(WorldAbout { color: world.color, ..WorldAbout::default() });
        self.clean_statics = OnceLock::new();
        Ok(())
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
        let options = &self.possible(options, monitor);
        let units = self.unit_images(lights, options, monitor)?;
        let lights = lights.iter().zip(units);
        let lights = lights.map(|(light, (unit, maker))| {
            let mut image = Image::new(unit.width, unit.height, 3);
            image.add_scaled(&unit, &light.radiance);
            RelitLight { name: light.name.clone(), image, maker }
        });
        let [static_light, world] = self.statics(options.denoise)?;
        Ok(Relit {
            lights: lights.collect(),
            static_light,
            world,
            albedo: self.aovs.albedo.clone(),
            normal: self.aovs.normal.clone(),
            depth: self.aovs.depth.clone(),
            alpha: self.aovs.alpha.clone(),
            scene_hash: self.scene_hash.clone(),
            samples: self.samples(),
        })
    }

    /// Paths per pixel of the bake; 0 without one.
    fn samples(&self) -> u32 {
        self.gather().map_or(0, |gather| gather.dump().manifest().samples())
    }

    /// Static light and world; without noise they are made once.
    pub(crate) fn statics(&self, denoise: bool) -> Result<[Image; 2], SessionError> {
        if !denoise {
            return Ok([self.aovs.emission.clone(), self.aovs.world.clone()]);
        }
        if let Some(clean) = self.clean_statics.get() {
            return Ok(clean.clone());
        }
        let mut statics = [self.aovs.emission.clone(), self.aovs.world.clone()];
        self.denoise.lit_images(&mut statics, DenoiseQuality::High)?;
        Ok(self.clean_statics.get_or_init(|| statics).clone())
    }

    /// The options without denoising where there is no denoiser, which the user is told.
    pub(crate) fn possible(&self, options: &RelightOptions, monitor: &Monitor) -> RelightOptions {
        let missing = if options.denoise { self.denoise.missing() } else { None };
        if let Some(reason) = &missing {
            monitor.warn(reason);
        }
        RelightOptions { denoise: options.denoise && missing.is_none(), ..*options }
    }

    /// Each light's picture for radiance 1, from the cache or made anew; all that are gathered in one pass.
    pub(crate) fn unit_images(
        &self,
        lights: &[Light],
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> Result<Vec<(Arc<Image>, Maker)>, SessionError> {
        let makers = lights.iter().map(|light| self.maker(light, options)).collect::<Result<Vec<_>, _>>()?;
        let mut units: Vec<Option<Arc<Image>>> =
            lights.iter().zip(&makers).map(|(light, maker)| self.cache.get(light, *maker)).collect();
        let missing: Vec<usize> = (0..lights.len()).filter(|i| units[*i].is_none()).collect();
        let stage = monitor.stage(Stage::Gather, 0, missing.len() as u64);
        let (proxied, gathered): (Vec<usize>, Vec<usize>) =
            missing.into_iter().partition(|i| makers[*i] == Maker::Proxy);
        let views = self.direct_views(proxied.iter().map(|i| &lights[*i]), monitor)?;
        for (i, view) in proxied.into_iter().zip(views) {
            let mut image = self.proxies.unit_image(&lights[i], &self.compute, monitor)?;
            if let Some(view) = view {
                image.add_scaled(&view, &[1.0; 3]);
            }
            units[i] = Some(self.cache.insert(&lights[i], makers[i], image));
            stage.advance(1, &lights[i].name);
        }
        // A few at a time, so that progress shows and memory stays bounded.
        for group in gathered.chunks(8) {
            if monitor.cancelled() {
                return Err(SessionError::Cancelled);
            }
            let group_lights: Vec<Light> = group.iter().map(|i| lights[*i].clone()).collect();
            self.warn_of(&group_lights, monitor);
            let mut images = self.gather_images(&group_lights, SampleSplit::All, monitor)?;
            if options.denoise {
                self.denoise.images(&mut images, DenoiseQuality::High)?;
            }
            for (i, image) in group.iter().zip(images) {
                units[*i] = Some(self.cache.insert(&lights[*i], makers[*i], image));
                stage.advance(1, &lights[*i].name);
            }
        }
        Ok(units.into_iter().flatten().zip(makers).collect())
    }

    /// Says which lights are hardly met by paths, or too small for the bake, so that their gathered pictures are to be trusted less.
    pub(crate) fn warn_of(&self, lights: &[Light], monitor: &Monitor) {
        let rare = |light: &Light| Some(self.sight.as_ref()?.rare(light)?.warning(light));
        let small = |light: &Light| too_small(self.gather()?, light);
        lights
            .iter()
            .filter_map(rare)
            .chain(lights.iter().filter_map(small))
            .for_each(|text| monitor.warn(&text));
    }

    fn maker(&self, light: &Light, options: &RelightOptions) -> Result<Maker, SessionError> {
        let proxy = self.proxies().covering(light).filter(|proxy| match options.with {
            With::Gather => false,
            With::Proxy => true,
            With::Auto if self.gather.is_none() => true,
            With::Auto => {
                proxy.beats_gather(options.denoise, self.samples()) && self.proxies().knowing(light).is_some()
            }
        });
        match (proxy, &self.gather, options.denoise) {
            (Some(_), _, _) => Ok(Maker::Proxy),
            (None, Some(_), true) => Ok(Maker::GatherDenoised),
            (None, Some(_), false) => Ok(Maker::Gather),
            (None, None, _) => Err(SessionError::Settings(format!(
                "light '{}' is of a type, size or visibility that no proxy in {} covers; relight from its bake",
                light.name,
                self.folder.display()
            ))),
        }
    }

    /// Does some work with a proxy on the GPU; nothing comes back where there is none, or the CPU has to do it.
    pub(crate) fn on_gpu_proxy<R>(
        &self,
        kind: LightKind,
        monitor: &Monitor,
        work: impl Fn(&GpuProxy) -> Result<R, SessionError>,
    ) -> Result<Option<R>, SessionError> {
        self.proxies.attempt(kind, &self.compute, monitor, work)
    }

    /// What the camera sees of lights directly, which proxies do not learn: exact from the dump, left out without one.
    fn direct_views<'a>(
        &self,
        lights: impl Iterator<Item = &'a Light>,
        monitor: &Monitor,
    ) -> Result<Vec<Option<Image>>, SessionError> {
        let lights: Vec<&Light> = lights.collect();
        let seen: Vec<&Light> = lights.iter().copied().filter(|light| light.lobes.camera != 0.0).collect();
        if self.gather.is_none() {
            for light in &seen {
                monitor.warn(&format!(
                    "light '{}' itself is not shown, only its light: that needs the bake",
                    light.name
                ));
            }
            return Ok(vec![None; lights.len()]);
        }
        let mut views = self
            .gather_images(&seen.into_iter().map(camera_only).collect::<Vec<_>>(), SampleSplit::All, monitor)?
            .into_iter();
        let view = |light: &Light| if light.lobes.camera != 0.0 { views.next() } else { None };
        Ok(lights.into_iter().map(view).collect())
    }

    /// Unit images by the dump; none without one.
    pub(crate) fn gather_images(
        &self,
        lights: &[Light],
        half: SampleSplit,
        monitor: &Monitor,
    ) -> Result<Vec<Image>, SessionError> {
        match &self.gather {
            Some(gather) => gather.unit_images(lights, half, &self.compute, monitor),
            None => Ok(Vec::new()),
        }
    }
}

/// What there is to say of a light that is smaller than the steps in which a dump holds positions: those grow with the distance
/// of the farthest vertex that a tile sees.
pub(crate) fn too_small(gather: &Gather, light: &Light) -> Option<String> {
    /// Metres. Penumbras of larger lights show.
    const SHOWS: f32 = 5e-3;
    let radius = gather.enlarged(&light.shape).filter(|radius| *radius > SHOWS)?;
    Some(format!(
        "light '{}' is too small for this bake and lights as if it were {:.0} mm across; what lies that close to it may lose \
         some of its light. Hide or shrink what is far away (a ground plane, a backdrop), and bake again",
        light.name,
        2000.0 * radius
    ))
}

/// The part of a light that the camera sees directly, which proxies do not learn.
pub(crate) fn camera_only(light: &Light) -> Light {
    let camera = light.lobes.camera;
    let lobes = LobeFactors { camera, diffuse: 0.0, glossy: 0.0, transmission: 0.0, volume: 0.0 };
    Light { lobes, ..light.clone() }
}
