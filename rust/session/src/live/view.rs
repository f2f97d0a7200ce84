use super::shared::State;
use crate::bake::features::camera;
use crate::bake::guiding::{GuideCoverage, GuidingRecord};
use crate::device::compute::Compute;
use crate::device::connections::Connections;
use crate::device::gather::DeviceGather;
use crate::device::proxies::DeviceProxies;
use crate::files::base_layers::BaseLayers;
use crate::files::proxies::Proxies;
use crate::relight::denoise::Denoise;
use crate::relight::film::Film;
use crate::relight::frame::downsampled;
use crate::relight::statics::StaticLayer;
use relume_dump::{AovSums, Aovs, Dump};
use relume_gather::{DenoiseQuality, Gather};
use std::sync::Arc;

/// Quality of denoised features that more paths will renew.
const PASSING: DenoiseQuality = DenoiseQuality::Fast;

/// Inputs of pictures: whole passes, features, static layers, proxies.
pub(super) struct BakeView {
    /// Deliveries of the work that are in it.
    pub deliveries: u64,
    /// Identity of the bake.
    pub bake: String,
    pub film: Film,
    /// Features and static layers of all plates of the film.
    pub aovs: Aovs,
    /// Sums behind `aovs`; empty without paths.
    sums: AovSums,
    pub passes: Vec<DeviceGather>,
    /// Light of the scene's own emitters, and of the world.
    pub statics: [StaticLayer; 2],
    pub proxies: DeviceProxies,
    /// Denoisers for the full size, for half and for a quarter of it.
    pub denoise: [Denoise; 3],
    /// Scene in which lights are connected, once it is ready.
    pub connections: Option<Arc<Connections>>,
    /// Coverage of lights by the paths.
    pub coverage: Option<GuideCoverage>,
    /// Paths per pixel behind the features that the denoisers use, and how well those are denoised themselves.
    features: (u32, DenoiseQuality),
    /// Quality that settled pictures are denoised at.
    pub quality: DenoiseQuality,
}

/// Deliveries of the work since the last were taken.
pub(super) struct Delivered {
    deliveries: u64,
    dump: Option<Dump>,
    guiding_record: GuidingRecord,
    base: Option<Arc<BaseLayers>>,
    connections: Option<Arc<Connections>>,
    pub proxies: Option<Proxies>,
}

impl Delivered {
    pub fn take(state: &mut State) -> Self {
        Self {
            deliveries: state.deliveries,
            dump: state.dump.clone(),
            guiding_record: state.guiding_record.clone(),
            base: state.base.clone(),
            connections: state.connections.clone(),
            proxies: state.proxies.take(),
        }
    }
}

impl BakeView {
    /// Inputs that are there now; all that is known of the same bake is kept.
    pub fn new(delivered: Delivered, compute: &Compute, before: Option<Self>) -> Option<Self> {
        let Delivered { deliveries, dump, guiding_record, base, connections, proxies } = delivered;
        let Some(dump) = dump else {
            let base = base?;
            let proxies = DeviceProxies::new(proxies.unwrap_or_default());
            return Some(Self::of(
                deliveries,
                &base.scene_hash,
                Film::PLAIN,
                (AovSums::default(), base.aovs.clone()),
                Vec::new(),
                proxies,
                compute,
            ));
        };
        let bake = dump.manifest().bake_id();
        let camera = camera(dump.manifest()).ok();
        let film = camera.as_ref().and_then(|camera| Film::of(dump.manifest(), camera).ok());
        let film = film.unwrap_or(Film::PLAIN);
        let same =
            before.filter(|before| before.bake == bake && before.samples() <= dump.manifest().samples());
        let view = match same {
            Some(before) => before.grown(deliveries, &dump, proxies, compute),
            None => {
                let proxies = DeviceProxies::new(proxies.unwrap_or_default());
                let passes = (0..dump.manifest().passes.len()).map(|pass| gather(&dump, pass)).collect();
                let mut sums = AovSums::default();
                sums.extend(&dump);
                let aovs = sums.means(&dump);
                Self::of(deliveries, &bake, film, (sums, aovs), passes, proxies, compute)
            }
        };
        let features = film.features(&view.aovs);
        let coverage =
            camera.map(|camera| GuideCoverage::new(&guiding_record, dump.manifest(), &features, &camera));
        drop(features);
        let connections = connections.filter(|connections| connections.is_of(dump.manifest()));
        Some(Self { coverage, ..view }.connected(connections))
    }

    fn of(
        deliveries: u64,
        bake: &str,
        film: Film,
        (sums, aovs): (AovSums, Aovs),
        passes: Vec<DeviceGather>,
        proxies: DeviceProxies,
        compute: &Compute,
    ) -> Self {
        let denoise = denoisers(&film.features(&aovs), compute, PASSING);
        let statics = StaticLayer::of(&aovs);
        let mut view = Self {
            deliveries,
            bake: bake.into(),
            film,
            aovs,
            sums,
            passes,
            statics,
            proxies,
            denoise,
            connections: None,
            coverage: None,
            features: (0, PASSING),
            quality: DenoiseQuality::Balanced,
        };
        view.features.0 = view.samples();
        view
    }

    /// Connects the lights of all passes: as many levels as there are passes up to each, so that the first are quick.
    fn connected(mut self, connections: Option<Arc<Connections>>) -> Self {
        if let Some(connections) = &connections {
            let passes = self.passes.iter_mut().enumerate();
            passes.for_each(|(number, pass)| pass.connect(connections, number + 1));
        }
        self.connections = connections.or(self.connections);
        self
    }

    /// Adds passes or replaces proxies of the same bake.
    fn grown(self, deliveries: u64, dump: &Dump, proxies: Option<Proxies>, compute: &Compute) -> Self {
        let mut view = Self { deliveries, ..self };
        if let Some(proxies) = proxies {
            view.proxies = DeviceProxies::new(proxies);
        }
        let (known, now) = (view.passes.len(), dump.manifest().passes.len());
        if now == known {
            return view;
        }
        view.passes.extend((known..now).map(|pass| gather(dump, pass)));
        view.sums.extend(dump);
        view.aovs = view.sums.means(dump);
        view.statics = StaticLayer::of(&view.aovs);
        // Features settle long before the light does; preparing them costs two denoised pictures.
        const RENEW: u32 = 4;
        if view.samples() >= RENEW * view.features.0 {
            view.renew_features(compute, PASSING);
        }
        view
    }

    fn renew_features(&mut self, compute: &Compute, quality: DenoiseQuality) {
        self.denoise = denoisers(&self.film.features(&self.aovs), compute, quality);
        self.features = (self.samples(), quality);
    }

    /// Prepares for rest, when the render thread has the machine: settled pictures are those of
    /// [`crate::relight::relighter::Relighter`].
    pub fn prepare_for_rest(&mut self, compute: &Compute) {
        self.passes.iter().for_each(DeviceGather::allow_sorting);
        self.quality = DenoiseQuality::High;
        let best = (self.samples(), DenoiseQuality::High);
        if self.features != best {
            self.renew_features(compute, best.1);
        }
    }

    /// Prepares for paths that are traced, or proxies that are trained, beside the render thread.
    pub fn share_machine(&mut self) {
        self.quality = DenoiseQuality::Balanced;
    }

    /// Paths per pixel.
    pub fn samples(&self) -> u32 {
        self.passes.iter().map(DeviceGather::samples).sum()
    }

    /// True if pictures of half the size are worth making.
    pub fn can_be_halved(&self) -> bool {
        let (width, rows) = (self.aovs.alpha.width, self.aovs.alpha.height);
        width.min(rows / self.film.plates()) >= 128 && self.film.can_be_halved(rows)
    }

    /// Side of the largest blocks of pixels in which lights may be connected: 1, 2 or 4.
    pub fn coarsest_block(&self) -> usize {
        match self.can_be_halved() {
            false => 1,
            true if self.film.can_be_halved(self.aovs.alpha.height / 2) => 4,
            true => 2,
        }
    }

    /// The denoiser for pictures of the full size (1), of half (2) or a quarter (4) of it.
    pub fn denoise(&self, scale: usize) -> &Denoise {
        &self.denoise[scale.ilog2() as usize]
    }
}

fn gather(dump: &Dump, pass: usize) -> DeviceGather {
    DeviceGather::new(Gather::new(dump.passes(pass..pass + 1)))
}

fn denoisers(aovs: &Aovs, compute: &Compute, quality: DenoiseQuality) -> [Denoise; 3] {
    let of = |aovs: &Aovs, features| Denoise::new(aovs, compute.gpu.as_deref()).with_features(features);
    let half = halved(aovs);
    [of(aovs, Some(quality)), of(&half, None), of(&halved(&half), None)]
}

fn halved(aovs: &Aovs) -> Aovs {
    Aovs {
        albedo: downsampled(&aovs.albedo),
        normal: downsampled(&aovs.normal),
        depth: downsampled(&aovs.depth),
        emission: downsampled(&aovs.emission),
        world: downsampled(&aovs.world),
        alpha: downsampled(&aovs.alpha),
    }
}

/// Range of [`BakeView::statics`] that is shown: without the paths' own world if another is.
pub(super) fn shown_statics(is_other_world: bool) -> std::ops::RangeTo<usize> {
    if is_other_world { ..1 } else { ..2 }
}
