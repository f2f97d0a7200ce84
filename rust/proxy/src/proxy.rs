use std::sync::Arc;

use half::f16;
use relume_image::Image;
use relume_scene::LightShape;
use serde::{Deserialize, Serialize};

use crate::encoded::EncodedTiles;
use crate::encoding::{LightEncoding, OutputScale};
use crate::evaluate::Evaluator;
use crate::gpu::{DeviceNetwork, OnDevice, Parts};
use crate::light::is_narrow;
use crate::network::{FastNetwork, Network, ReferenceNetwork};
use crate::params::ParamLayout;
use crate::scene_cache::{Normalisation, SceneCache};
use crate::simd::Isa;
use crate::{LightKind, LightParams, MAX_PARAMS, NetworkConfig, PixelFeatures, ProxyError, SizeRange};

/// Facts about a proxy besides its weights and pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProxyInfo {
    /// The lights that it learned.
    pub kind: LightKind,
    /// The network.
    pub network: NetworkConfig,
    /// Pixels per row and rows.
    pub image: [usize; 2],
    /// Sizes of the training lights, metres.
    pub size: SizeRange,
    /// Least and greatest value of each light parameter seen in training; empty before the first step.
    pub trained_ranges: Vec<[f32; 2]>,
    /// Normalisation of inputs.
    pub normalisation: Normalisation,
    /// Scale of outputs.
    pub output_scale: OutputScale,
    /// Steps and samples trained.
    pub steps: u64,
    /// Samples trained.
    pub samples: u64,
    /// Error on lights never trained on, when last measured.
    pub held_out: Option<Scores>,
    /// Hash of the scene, as its owner makes it.
    pub scene_hash: String,
}

/// Mean error over the held-out lights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Peak signal-to-noise ratio of Reinhard-mapped values, decibels; each image exposed to a mean of 0.5.
    pub psnr: f32,
    /// Symmetric mean absolute percentage error, 0..1 (lower is better).
    pub smape: f32,
    /// Lights measured.
    pub lights: usize,
    /// Samples trained at that time.
    pub samples: u64,
}

/// A trained network for one image and one light kind, ready to relight. Cloning is cheap; all methods use all cores and
/// may be called from several threads.
#[derive(Clone)]
pub struct Proxy {
    info: Arc<ProxyInfo>,
    features: Arc<PixelFeatures>,
    engine: Arc<Engine>,
}

impl std::fmt::Debug for Proxy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Proxy").field(&self.info).finish()
    }
}

enum Engine {
    Reference(Box<Evaluator<ReferenceNetwork>>),
    Fast(Box<Evaluator<FastNetwork>>),
}

macro_rules! with_evaluator {
    ($proxy:expr, $evaluator:ident => $body:expr) => {
        match &*$proxy.engine {
            Engine::Reference($evaluator) => $body,
            Engine::Fast($evaluator) => $body,
        }
    };
}

impl Proxy {
    /// Proxy from weights in the order of the network's layout, which are rounded to what its file holds.
    pub(crate) fn new(info: ProxyInfo, features: Arc<PixelFeatures>, mut params: Vec<f32>) -> Self {
        params.iter_mut().for_each(|weight| *weight = f16::from_f32(*weight).to_f32());
        let scene = SceneCache::new(&features, info.normalisation);
        let light = LightEncoding::new(info.kind, info.normalisation, info.size);
        let (count, isa) = (features.pixel_count(), Isa::detect());
        let engine = match &info.network {
            NetworkConfig::Reference { width, layers, grid } => {
                let network = ReferenceNetwork::new(*width, *layers, grid, info.image, light);
                Engine::Reference(Box::new(Evaluator::new(network, params, &scene, count, isa)))
            }
            NetworkConfig::Fast { width, layers, grid } => {
                let network = FastNetwork::new(*width, *layers, grid, info.image, light);
                Engine::Fast(Box::new(Evaluator::new(network, params, &scene, count, isa)))
            }
        };
        Self { info: Arc::new(info), features, engine: Arc::new(engine) }
    }

    /// Facts about the proxy.
    pub fn info(&self) -> &ProxyInfo {
        &self.info
    }

    /// The pixels that it was trained for.
    pub fn features(&self) -> &Arc<PixelFeatures> {
        &self.features
    }

    /// Network as a device runs it.
    pub(crate) fn device_network(&self) -> DeviceNetwork {
        self.parts().pack()
    }

    /// The matrices of what a device runs.
    pub(crate) fn parts(&self) -> Parts<'_> {
        with_evaluator!(self, e => e.network().parts(e.params()))
    }

    /// The encoded pixels, in tiles of [`DeviceNetwork::pixel_rows`].
    pub(crate) fn encoded(&self) -> &EncodedTiles {
        with_evaluator!(self, e => e.encoded())
    }

    /// Scale and shift of each layer for a light.
    pub(crate) fn modulation(&self, light: &LightParams) -> Vec<f32> {
        with_evaluator!(self, e => e.network().modulation(e.params(), &e.light(light)))
    }

    /// The gradient by a light's parameters from those by [`Proxy::modulation`] and by the parameters that the analytic
    /// features see.
    pub(crate) fn light_gradient(
        &self,
        light: &LightParams,
        d_modulation: &[f32],
        d_features: &[f32],
    ) -> [f32; MAX_PARAMS] {
        with_evaluator!(self, e => {
            let lit = e.light(light);
            let sum = e.network().gradient_sum(e.params(), &lit, d_modulation, d_features);
            e.finish_light_gradient(&lit, &sum)
        })
    }

    pub(crate) fn params(&self) -> &[f32] {
        with_evaluator!(self, e => e.params())
    }

    pub(crate) fn layout(&self) -> &ParamLayout {
        with_evaluator!(self, e => e.network().layout())
    }

    /// True if this proxy answers for such a light: its kind, sizes within the trained range and cones no narrower than
    /// the trained ones (with a tenth of slack). [`Proxy::has_learned_place`] is about positions.
    pub fn covers(&self, shape: &LightShape) -> bool {
        let (kind, SizeRange { min, max }) = (self.info.kind, self.info.size);
        LightKind::of(shape) == Some(kind)
            && kind.sizes(shape).all(|size| (0.9 * min..=1.1 * max).contains(&size))
            && !is_narrow(shape)
    }

    /// True if the centre of a light of this kind is in the box of the training lights (with a tenth of slack on each
    /// side). True before the first step, when nothing was learned anywhere.
    pub fn has_learned_place(&self, shape: &LightShape) -> bool {
        let Some(light) = LightParams::from_shape(shape) else { return false };
        // The first three parameters of every kind.
        light.as_slice().iter().zip(&self.info.trained_ranges).take(3).all(|(value, [least, greatest])| {
            let slack = 0.1 * (greatest - least);
            (least - slack..=greatest + slack).contains(value)
        })
    }

    /// The unit image of a light.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`] if the proxy was trained for other lights.
    pub fn unit_image(&self, light: &LightParams) -> Result<Image, ProxyError> {
        let mut image = Image::new(self.info.image[0], self.info.image[1], 3);
        self.forward(light, bytemuck::cast_slice_mut(&mut image.data))?;
        Ok(image)
    }

    /// The unit image of a light into `out`, row-major, as long as the image has pixels.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`] or [`ProxyError::Length`].
    pub fn forward(&self, light: &LightParams, out: &mut [[f32; 3]]) -> Result<(), ProxyError> {
        self.check_kind(light)?;
        check_length("out", self.features.pixel_count(), out.len())?;
        let (scale, _) = self.info.output_scale.of(light);
        with_evaluator!(self, e => e.forward(light, scale, out));
        Ok(())
    }

    /// The unit image of a light at some pixels (row-major numbers) into `out`.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], [`ProxyError::Length`] or [`ProxyError::PixelOutside`].
    pub fn forward_pixels(
        &self,
        pixels: &[u32],
        light: &LightParams,
        out: &mut [[f32; 3]],
    ) -> Result<(), ProxyError> {
        self.check_kind(light)?;
        self.check_pixels(pixels)?;
        check_length("out", pixels.len(), out.len())?;
        let (scale, _) = self.info.output_scale.of(light);
        with_evaluator!(self, e => e.forward_pixels(pixels, light, scale, out));
        Ok(())
    }

    /// Pixels of a coarser image, every `stride`-th in both directions starting at half of it, and that image's size:
    /// the input of [`Proxy::forward_pixels`] for a quick preview.
    pub fn coarse_pixels(&self, stride: usize) -> (Vec<u32>, [usize; 2]) {
        let [width, height] = self.info.image;
        let stride = stride.clamp(1, width.min(height));
        let along = |size: usize| (stride / 2..size).step_by(stride);
        let pixels = along(height).flat_map(|y| along(width).map(move |x| (y * width + x) as u32)).collect();
        (pixels, [along(width).count(), along(height).count()])
    }

    /// Gradient of a loss by the light's parameters (in the order of [`LightParams::as_slice`]), from its gradient
    /// `d_out` by the values that [`Proxy::forward_pixels`] gives for `pixels`. Where the network's output is clamped to
    /// zero, the gradient is that of the output before the clamp.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], [`ProxyError::Length`] or [`ProxyError::PixelOutside`].
    pub fn backward(
        &self,
        pixels: &[u32],
        light: &LightParams,
        d_out: &[[f32; 3]],
    ) -> Result<Vec<f32>, ProxyError> {
        self.check_kind(light)?;
        self.check_pixels(pixels)?;
        check_length("d_out", pixels.len(), d_out.len())?;
        let scale = self.info.output_scale.of(light);
        let gradient = with_evaluator!(self, e => e.backward(pixels, light, scale, d_out));
        Ok(gradient[..light.as_slice().len()].to_vec())
    }

    pub(crate) fn check_kind(&self, light: &LightParams) -> Result<(), ProxyError> {
        if light.kind() != self.info.kind {
            return Err(ProxyError::WrongKind { trained: self.info.kind, asked: light.kind() });
        }
        Ok(())
    }

    pub(crate) fn check_pixels(&self, pixels: &[u32]) -> Result<(), ProxyError> {
        let count = with_evaluator!(self, e => e.pixel_count());
        match pixels.iter().find(|p| **p as usize >= count) {
            Some(&pixel) => Err(ProxyError::PixelOutside { pixel, count }),
            None => Ok(()),
        }
    }
}

pub(crate) fn check_length(what: &'static str, expected: usize, found: usize) -> Result<(), ProxyError> {
    if expected != found {
        return Err(ProxyError::Length { what, expected, found });
    }
    Ok(())
}
