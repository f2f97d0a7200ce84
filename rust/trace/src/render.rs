//! Tracing of a scene to a path dump: all passes, all tiles, all cores.

use std::sync::{
    Arc, Mutex, OnceLock, PoisonError,
    atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering},
};

use glam::Vec3;
use relume_dump::{DumpError, FORMAT_VERSION, Manifest, Pass, ShardSink, TileRect, TileSamples};
use relume_scene::{Light, Scene};

use crate::{
    bvh::{BvhError, SceneBvh},
    camera::CameraSampler,
    environment::EnvironmentLight,
    guide::Guide,
    integrator::{Integrator, PathScratch, PathSink, Plate, ShadowDifferences, plate_count},
    light_classes::{LightClasses, segment_classes},
    media::{Bounds, Media},
    sampler::PixelSampler,
    settings::TraceSettings,
    shading::PreparedMaterials,
    static_light::{SeeThrough, StaticLights},
};

/// Why a scene could not be traced.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The scene's trees could not be built.
    #[error(transparent)]
    Bvh(#[from] BvhError),
    /// A shard could not be stored.
    #[error(transparent)]
    Dump(#[from] DumpError),
    /// The dump is of another size, seed or division than the settings say.
    #[error("the dump's {0} differs from the trace settings; make its manifest with Tracer::manifest")]
    Mismatch(&'static str),
    /// Worker threads could not be started.
    #[error("cannot start {threads} worker threads; ask for fewer")]
    Threads {
        /// Number of threads that were asked for.
        threads: usize,
        /// Error of the system.
        source: rayon::ThreadPoolBuildError,
    },
}

/// Outcome of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TraceOutcome {
    /// All shards are there.
    Complete,
    /// Stopped by [`Control::cancel`]; the shards that are there are whole.
    Cancelled,
}

/// Progress so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceProgress {
    /// Paths traced or found in the dump.
    pub paths: u64,
    /// Paths in all.
    pub paths_total: u64,
    /// Segments traced in this run.
    pub segments: u64,
    /// Shards stored or found.
    pub shards: usize,
    /// Shards in all.
    pub shards_total: usize,
}

/// Talks to a running trace from other threads.
#[derive(Default)]
pub struct Control<'a> {
    /// Set to stop; looked at after every pixel.
    pub cancel: Arc<AtomicBool>,
    /// Called after every shard, one call at a time.
    pub on_progress: Option<Box<dyn Fn(TraceProgress) + Sync + Send + 'a>>,
    /// Called with its number before the first path of every pass that is traced: the lights that it is guided to, instead of
    /// those of the scene and the settings.
    pub lights: Option<Box<dyn Fn(usize) -> Vec<Light> + Sync + Send + 'a>>,
}

const FAST_GI_OF_TEXTURES: &str =
    "Fast GI Approximation takes other shares of the light of a world with textures than Cycles does";

const FAST_GI_IN_MEDIA: &str =
    "Fast GI Approximation replaces no bounce in a scene with volumes: every bounce is traced";

/// A scene made ready for tracing.
#[derive(Debug)]
pub struct Tracer<'a> {
    pub(crate) integrator: Integrator<'a>,
    guide: Option<Guide>,
    pub(crate) settings: TraceSettings,
    warnings: Vec<String>,
}

/// Traces all of a scene's paths into `sink`, whose manifest comes from [`Tracer::manifest`].
///
/// # Errors
/// If the scene is too large, or a shard cannot be stored.
pub fn trace(
    scene: &Scene,
    settings: &TraceSettings,
    sink: &dyn ShardSink,
    control: &Control<'_>,
) -> Result<TraceOutcome, TraceError> {
    Tracer::new(scene, settings)?.trace(sink, control)
}

impl<'a> Tracer<'a> {
    /// Builds trees, materials and light tables. The scene has to be valid ([`Scene::validate`]).
    ///
    /// # Errors
    /// If the scene has too many triangles.
    pub fn new(scene: &'a Scene, settings: &TraceSettings) -> Result<Self, TraceError> {
        Ok(Self::with_bvh(scene, settings, SceneBvh::new(scene)?))
    }

    /// [`Tracer::new`] with the trees that another tracer of the scene has built ([`Tracer::bvh`]).
    pub fn with_bvh(scene: &'a Scene, settings: &TraceSettings, bvh: SceneBvh) -> Self {
        let (materials, mut warnings) = PreparedMaterials::new(scene);
        let environment = EnvironmentLight::new(scene, world_color(scene, settings), &materials);
        let mut paths = settings.paths.clone();
        let adds = paths.adds_light();
        let lights = if paths.sample_static_lights || adds {
            StaticLights::new(scene, &materials, &environment, adds)
        } else {
            None
        };
        let classes = segment_classes(scene, &paths).unwrap_or_else(|warning| {
            warnings.push(warning);
            None
        });
        let media = Media::new(scene, &materials, &guide_targets(scene, settings), &mut warnings);
        if paths.cuts_rays() && media.is_some() {
            warnings.push(FAST_GI_IN_MEDIA.into());
        }
        let world = &scene.world;
        let is_textured = world.texture.is_some() || world.parts.iter().any(|part| part.texture.is_some());
        if paths.cuts_rays() && is_textured {
            warnings.push(FAST_GI_OF_TEXTURES.into());
        }
        if paths.cuts_rays() && (media.is_some() || classes.is_none()) {
            paths.fast_gi = None;
        }
        let shadows = ShadowDifferences::new(scene, media.as_ref());
        let integrator = Integrator {
            scene,
            media,
            bvh,
            camera: CameraSampler::new(&scene.camera, paths.filter),
            materials,
            environment,
            lights,
            see_through: SeeThrough::new(scene),
            shadows,
            classes: classes.map(|classes| LightClasses::new(scene, classes)),
            catches: scene.has_shadow_catchers(),
            settings: paths,
        };
        let guide = Guide::new(&guide_targets(scene, settings), settings.guiding);
        Self { integrator, guide, settings: settings.clone(), warnings }
    }

    /// The trees, which copies share.
    pub fn bvh(&self) -> &SceneBvh {
        &self.integrator.bvh
    }

    /// Warnings for the user about parts of materials that could not be represented.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The manifest of a dump of this scene with these settings.
    pub fn manifest(&self) -> Manifest {
        manifest(self.integrator.scene, &self.settings)
    }

    /// Traces every shard that `sink` does not have yet. What is traced depends on the scene with its lights, the seed and the
    /// settings of paths and guiding alone, not on threads, tiles or passes. A dump may hold shards that were guided to
    /// other lights: each is right by itself.
    ///
    /// # Errors
    /// If `sink` is for a dump of another shape, or cannot store a shard.
    pub fn trace(&self, sink: &dyn ShardSink, control: &Control<'_>) -> Result<TraceOutcome, TraceError> {
        let manifest = sink.manifest();
        if let Some(difference) = self.manifest().difference(manifest) {
            return Err(TraceError::Mismatch(difference));
        }
        let queue = ShardQueue::new(self, manifest, sink, control);
        match self.settings.threads {
            0 => rayon::broadcast(|_| queue.work()),
            threads => {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                pool.map_err(|source| TraceError::Threads { threads, source })?.broadcast(|_| queue.work())
            }
        };
        queue.finish()
    }

    /// Traces the paths of one pixel of the dump into `sink`; rows below the camera's are those of its further plates.
    pub fn trace_pixel(
        &self,
        x: usize,
        y: usize,
        pass: Pass,
        scratch: &mut PathScratch,
        sink: &mut impl PathSink,
    ) {
        self.trace_guided((x, y), pass, self.guide.as_ref(), scratch, sink);
    }

    /// Sampler of a pixel. Plates of the film have the same numbers.
    pub fn sampler(&self, (x, y): (usize, usize)) -> PixelSampler {
        let rows = self.integrator.scene.camera.height;
        PixelSampler::new(self.settings.seed, x as u32, (y % rows) as u32)
    }

    pub(crate) fn trace_guided(
        &self,
        (x, y): (usize, usize),
        pass: Pass,
        guide: Option<&Guide>,
        scratch: &mut PathScratch,
        sink: &mut impl PathSink,
    ) {
        let sampler = self.sampler((x, y));
        let rows = self.integrator.scene.camera.height;
        let (plate, y) = (Plate::numbered(y / rows), y % rows);
        for sample in pass.first_sample..pass.first_sample + pass.samples {
            self.integrator.trace((x, y), plate, sampler, sample, guide, scratch, sink);
        }
    }
}

/// Lights that paths of these settings are guided to: the scene's and those that the settings name.
pub fn guide_targets(scene: &Scene, settings: &TraceSettings) -> Vec<Light> {
    scene.lights.iter().chain(&settings.guide_targets).cloned().collect()
}

/// The manifest of a dump of `scene`. With shadow catchers it has rows for each plate of the film ([`relume_dump::Manifest`]):
/// three or four times the camera's.
pub fn manifest(scene: &Scene, settings: &TraceSettings) -> Manifest {
    let camera = &scene.camera;
    let is_pinhole = CameraSampler::new(camera, settings.paths.filter).is_pinhole();
    let is_filled = scene.world.volume.is_some_and(|material| scene.materials[material].volume.is_some());
    Manifest {
        format_version: FORMAT_VERSION,
        scene_hash: scene.hash(),
        width: camera.width,
        height: camera.height * plate_count(scene, &settings.paths),
        tile_size: settings.tile_size,
        passes: settings.passes.passes(settings.samples),
        seed: settings.seed,
        camera: serde_json::to_value(camera).unwrap_or_default(),
        camera_position: is_pinhole.then(|| camera.world_from_camera.translation.to_array()),
        receivers: scene.receiver_names(),
        classes: segment_classes(scene, &settings.paths).unwrap_or_default(),
        settings: serde_json::to_value(&settings.paths).unwrap_or_default(),
        working_space: scene.working_space.clone(),
        world_color: world_color(scene, settings),
        world_map: scene.world_map(),
        recorded: is_filled
            .then(|| Bounds::of_scene(scene, &guide_targets(scene, settings)).corners().map(Vec3::into)),
    }
}

fn world_color(scene: &Scene, settings: &TraceSettings) -> [f32; 3] {
    settings.world_color.unwrap_or(scene.world.color)
}

/// Queue of (pass, tile) that the workers take from in order, so that the first picture comes first and no worker
/// waits for the others at the end of a pass.
struct ShardQueue<'a> {
    tracer: &'a Tracer<'a>,
    manifest: &'a Manifest,
    sink: &'a dyn ShardSink,
    control: &'a Control<'a>,
    /// Guide of the paths of each pass, once that is known.
    guides: Vec<OnceLock<Option<Guide>>>,
    next: AtomicUsize,
    segments: AtomicU64,
    /// Paths and shards done.
    done: Mutex<(u64, usize)>,
    failure: Mutex<Option<DumpError>>,
}

impl<'a> ShardQueue<'a> {
    fn new(
        tracer: &'a Tracer<'a>,
        manifest: &'a Manifest,
        sink: &'a dyn ShardSink,
        control: &'a Control<'a>,
    ) -> Self {
        Self {
            tracer,
            manifest,
            sink,
            control,
            guides: vec![OnceLock::new(); manifest.passes.len()],
            next: AtomicUsize::new(0),
            segments: AtomicU64::new(0),
            done: Mutex::new((0, 0)),
            failure: Mutex::new(None),
        }
    }

    fn shard_count(&self) -> usize {
        self.manifest.tile_count() * self.manifest.passes.len()
    }

    /// Loop of each thread until nothing is left.
    fn work(&self) {
        let mut scratch = PathScratch::default();
        let mut samples = TileSamples::new(TileRect { x: 0, y: 0, width: 0, height: 0 });
        let tiles = self.manifest.tile_count();
        while !self.control.cancel.load(Ordering::Relaxed) {
            let index = self.next.fetch_add(1, Ordering::Relaxed);
            if index >= self.shard_count() {
                break;
            }
            let (pass, tile) = (index / tiles, index % tiles);
            if !self.sink.is_complete(tile, pass) {
                if !self.trace_tile(tile, pass, &mut scratch, &mut samples) {
                    break;
                }
                if let Err(error) = self.sink.write(tile, pass, &samples) {
                    self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                    // The other workers find nothing left to do.
                    self.next.store(self.shard_count(), Ordering::Relaxed);
                    break;
                }
            }
            self.report(tile, pass);
        }
    }

    /// False if cancelled half-way.
    fn trace_tile(
        &self,
        tile: usize,
        pass: usize,
        scratch: &mut PathScratch,
        samples: &mut TileSamples,
    ) -> bool {
        let rect = self.manifest.tile_rect(tile);
        let (guide, pass) = (self.guide(pass), self.manifest.passes[pass]);
        samples.reset(rect);
        for y in rect.y..rect.y + rect.height {
            for x in rect.x..rect.x + rect.width {
                if self.control.cancel.load(Ordering::Relaxed) {
                    return false;
                }
                samples.begin_pixel();
                self.tracer.trace_guided((x, y), pass, guide, scratch, samples);
            }
        }
        self.segments.fetch_add(samples.record_count() as u64, Ordering::Relaxed);
        true
    }

    fn guide(&self, pass: usize) -> Option<&Guide> {
        match &self.control.lights {
            Some(lights) => {
                let new = || Guide::new(&lights(pass), self.tracer.settings.guiding);
                self.guides[pass].get_or_init(new).as_ref()
            }
            None => self.tracer.guide.as_ref(),
        }
    }

    fn report(&self, tile: usize, pass: usize) {
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        let paths = self.manifest.tile_rect(tile).pixel_count() as u64;
        done.0 += paths * u64::from(self.manifest.passes[pass].samples);
        done.1 += 1;
        if let Some(on_progress) = &self.control.on_progress {
            let pixels = (self.manifest.width * self.manifest.height) as u64;
            on_progress(TraceProgress {
                paths: done.0,
                paths_total: pixels * u64::from(self.manifest.samples()),
                segments: self.segments.load(Ordering::Relaxed),
                shards: done.1,
                shards_total: self.shard_count(),
            });
        }
    }

    fn finish(self) -> Result<TraceOutcome, TraceError> {
        if let Some(error) = self.failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error.into());
        }
        let done = self.done.into_inner().unwrap_or_else(PoisonError::into_inner).1;
        let all = self.manifest.tile_count() * self.manifest.passes.len();
        Ok(if done == all { TraceOutcome::Complete } else { TraceOutcome::Cancelled })
    }
}
