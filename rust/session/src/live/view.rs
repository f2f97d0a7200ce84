use super::gathered::Clean;
use super::shared::State;
use crate::bake::features::camera;
use crate::bake::guiding::{Guided, Rare, Sight};
use crate::device::compute::Compute;
use crate::device::gather::DeviceGather;
use crate::device::image::DeviceImage;
use crate::device::proxies::DeviceProxies;
use crate::files::base_layers::BaseLayers;
use crate::files::proxies::Proxies;
use crate::relight::denoise::Denoise;
use relume_dump::{AovSums, Aovs, Dump};
use relume_gather::{DenoiseQuality, Gather};
use relume_image::Image;
use relume_scene::{Light, LightShape};
use std::collections::VecDeque;
use std::sync::Arc;

/// How well features are denoised that more paths will renew.
const PASSING: DenoiseQuality = DenoiseQuality::Fast;

/// What there is to make pictures from: whole passes, features, static layers, proxies.
pub(super) struct View {
    /// Deliveries of the work that are in it.
    pub deliveries: u64,
    /// Which bake it is of.
    pub bake: String,
    pub aovs: Aovs,
    /// What `aovs` are the means of; nothing without paths.
    sums: AovSums,
    pub passes: Vec<DeviceGather>,
    /// Light of the scene's own emitters, and of the world.
    pub statics: [StaticLayer; 2],
    pub proxies: DeviceProxies,
    /// For the full size, and for half of it.
    pub denoise: [Denoise; 2],
    /// How often the paths meet lights.
    sight: Option<Sight>,
    /// What it says of the shapes that were asked for last.
    rare: VecDeque<(LightShape, Option<Rare>)>,
    /// Paths per pixel behind the features that the denoisers use, and how well those are denoised themselves.
    features: (u32, DenoiseQuality),
    /// What settled pictures are denoised with.
    pub quality: DenoiseQuality,
}

/// A layer that no light changes.
pub(super) struct StaticLayer {
    pub image: DeviceImage,
    pub clean: Option<Clean>,
    pub black: bool,
}

impl StaticLayer {
    /// Whether it is denoised as well as that, or need not be.
    pub fn is_done(&self, quality: DenoiseQuality) -> bool {
        self.black || self.clean.as_ref().is_some_and(|clean| clean.quality >= quality)
    }
}

/// What the work has delivered since it was last asked.
pub(super) struct Delivered {
    deliveries: u64,
    dump: Option<Dump>,
    guided: Guided,
    base: Option<Arc<BaseLayers>>,
    pub proxies: Option<Proxies>,
}

impl Delivered {
    pub fn take(state: &mut State) -> Self {
        Self {
            deliveries: state.deliveries,
            dump: state.dump.clone(),
            guided: state.guided.clone(),
            base: state.base.clone(),
            proxies: state.proxies.take(),
        }
    }
}

impl View {
    /// What there is now; takes over what the previous view knows of the same bake.
    pub fn new(delivered: Delivered, compute: &Compute, before: Option<Self>) -> Option<Self> {
        let Delivered { deliveries, dump, guided, base, proxies } = delivered;
        let Some(dump) = dump else {
            let base = base?;
            let proxies = DeviceProxies::new(proxies.unwrap_or_default());
            return Some(Self::of(
                deliveries,
                &base.scene_hash,
                (AovSums::default(), base.aovs.clone()),
                Vec::new(),
                proxies,
                compute,
            ));
        };
        let bake = dump.manifest().bake_id();
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
                Self::of(deliveries, &bake, (sums, aovs), passes, proxies, compute)
            }
        };
        let camera = camera(dump.manifest()).ok();
        let sight = camera.map(|camera| Sight::new(&guided, dump.manifest(), &view.aovs, &camera));
        Some(Self { sight, rare: VecDeque::new(), ..view })
    }

    fn of(
        deliveries: u64,
        bake: &str,
        (sums, aovs): (AovSums, Aovs),
        passes: Vec<DeviceGather>,
        proxies: DeviceProxies,
        compute: &Compute,
    ) -> Self {
        let denoise = denoisers(&aovs, compute, PASSING);
        let statics = static_layers(&aovs);
        let mut view = Self {
            deliveries,
            bake: bake.into(),
            aovs,
            sums,
            passes,
            statics,
            proxies,
            denoise,
            sight: None,
            rare: VecDeque::new(),
            features: (0, PASSING),
            quality: DenoiseQuality::Balanced,
        };
        view.features.0 = view.samples();
        view
    }

    /// The same bake with more passes or other proxies.
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
        view.statics = static_layers(&view.aovs);
        // Features settle long before the light does; preparing them costs two denoised pictures.
        const RENEW: u32 = 4;
        if view.samples() >= RENEW * view.features.0 {
            view.renew_features(compute, PASSING);
        }
        view
    }

    fn renew_features(&mut self, compute: &Compute, quality: DenoiseQuality) {
        self.denoise = denoisers(&self.aovs, compute, quality);
        self.features = (self.samples(), quality);
    }

    /// From now on the machine is the painter's: settled pictures are those that [`crate::relight::relighter::Relighter`] makes.
    pub fn rest(&mut self, compute: &Compute) {
        self.passes.iter().for_each(DeviceGather::allow_sorting);
        self.quality = DenoiseQuality::High;
        let best = (self.samples(), DenoiseQuality::High);
        if self.features != best {
            self.renew_features(compute, best.1);
        }
    }

    /// From now on paths are traced or proxies trained beside the painter.
    pub fn share_machine(&mut self) {
        self.quality = DenoiseQuality::Balanced;
    }

    /// What there is to say of a light that hardly any path meets. Kept, since it is asked again for every picture of a drag.
    pub fn rare(&mut self, light: &Light) -> Option<Rare> {
        const KEPT: usize = 256;
        if let Some((_, rare)) = self.rare.iter().find(|(shape, _)| *shape == light.shape) {
            return *rare;
        }
        let rare = self.sight.as_ref()?.rare(light);
        self.rare.push_front((light.shape, rare));
        self.rare.truncate(KEPT);
        rare
    }

    /// Paths per pixel.
    pub fn samples(&self) -> u32 {
        self.passes.iter().map(pass_samples).sum()
    }

    /// Whether pictures of half the size are worth making.
    pub fn can_be_halved(&self) -> bool {
        self.aovs.alpha.width.min(self.aovs.alpha.height) >= 128
    }

    /// The denoiser for pictures of the full size (1) or of half of it (2).
    pub fn denoise(&self, scale: usize) -> &Denoise {
        &self.denoise[scale - 1]
    }
}

pub(super) fn pass_samples(pass: &DeviceGather) -> u32 {
    pass.gather().dump().manifest().samples()
}

fn gather(dump: &Dump, pass: usize) -> DeviceGather {
    DeviceGather::new(Gather::new(dump.passes(pass..pass + 1)))
}

fn static_layers(aovs: &Aovs) -> [StaticLayer; 2] {
    [&aovs.emission, &aovs.world].map(|image| StaticLayer {
        image: DeviceImage::Cpu(image.clone()),
        clean: None,
        black: image.data.iter().all(|value| *value == 0.0),
    })
}

fn denoisers(aovs: &Aovs, compute: &Compute, quality: DenoiseQuality) -> [Denoise; 2] {
    let of = |aovs: &Aovs, features| Denoise::new(aovs, compute.gpu.as_deref()).with_features(features);
    [of(aovs, Some(quality)), of(&halved(aovs), None)]
}

fn halved(aovs: &Aovs) -> Aovs {
    Aovs {
        albedo: half(&aovs.albedo),
        normal: half(&aovs.normal),
        depth: half(&aovs.depth),
        emission: half(&aovs.emission),
        world: half(&aovs.world),
        alpha: half(&aovs.alpha),
    }
}

/// Which of [`View::statics`] are shown: not the paths' own world where another stands in its place.
pub(super) fn shown_statics(is_other_world: bool) -> std::ops::RangeTo<usize> {
    if is_other_world { ..1 } else { ..2 }
}

/// Half of the size by averages of two by two pixels; an odd last column or row is left out, as in
/// [`relume_proxy::Proxy::coarse_pixels`]. Pictures of a single row or column stay as they are.
pub(super) fn half(image: &Image) -> Image {
    if image.width < 2 || image.height < 2 {
        return image.clone();
    }
    let mut out = Image::new(image.width / 2, image.height / 2, image.channels);
    let row = out.width * out.channels;
    for (y, target) in out.data.chunks_exact_mut(row).enumerate() {
        let [upper, lower] = [2 * y, 2 * y + 1]
            .map(|y| &image.data[y * image.width * image.channels..][..image.width * image.channels]);
        for (i, value) in target.iter_mut().enumerate() {
            let (x, c) = (i / image.channels, i % image.channels);
            let [a, b] = [2 * x, 2 * x + 1].map(|x| x * image.channels + c);
            *value = 0.25 * (upper[a] + upper[b] + lower[a] + lower[b]);
        }
    }
    out
}

/// An image that its cache and a frame hold.
pub(super) type SharedImage = Arc<DeviceImage>;
