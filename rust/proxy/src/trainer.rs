use std::sync::Arc;

use relume_image::{Image, metrics};

use crate::encoding::{LightEncoding, OutputScale};
use crate::gpu::train::DeviceCore;
use crate::gradient::{Batch, GradientBuffers, batch_gradient};
use crate::network::{FastNetwork, Network, NetworkContext, ReferenceNetwork};
use crate::optim::Optimiser;
use crate::params::{ParamLayout, Role, Tensor};
use crate::pool::{Pool, images_of};
use crate::proxy::{ProxyInfo, Scores};
use crate::replay::{BLOCK, Replay};
use crate::sampling::Sampler;
use crate::scene_cache::{Normalisation, SceneCache};
use crate::schedule::{EMA_EVERY, batch_size, mean_share, progress, rates};
use crate::simd::Isa;
use crate::{
    LightKind, LightParams, NetworkConfig, PixelFeatures, Proxy, ProxyError, Rng, TargetMode, TargetSource,
    TrainConfig,
};

/// Counter of the random streams of held-out lights.
const HELD_OUT_STREAM: u64 = (1 << 63) + 2;

/// Trains one proxy, step by step. Between steps the caller may cancel, save, measure or take a [`Proxy`].
///
/// Equal seeds and equal answers of the source give equal weights, whatever the number of threads, and whether or not
/// the training was saved and resumed on the way (on machines with the same instruction set).
pub struct Trainer {
    pub(crate) config: TrainConfig,
    pub(crate) kind: LightKind,
    pub(crate) seed: u64,
    pub(crate) features: Arc<PixelFeatures>,
    pub(crate) state: TrainState,
    pub(crate) scene_hash: String,
    pub(crate) scene: Arc<SceneCache>,
    isa: Isa,
    pub(crate) core: Core,
    pub(crate) samples_of: Samples,
    /// Device on which steps are done, if not here. Weights and moments of the state are then empty.
    pub(crate) device: Option<Box<DeviceCore>>,
    /// Lights that training never sees, with their pictures.
    held_out: Vec<(LightParams, Image)>,
}

/// All that a resumed training needs besides its configuration.
#[derive(Clone, Debug)]
pub(crate) struct TrainState {
    pub params: Vec<f32>,
    pub optimiser: Optimiser,
    /// Running mean of the weights.
    pub mean: Vec<f32>,
    pub step: u64,
    pub samples: u64,
    pub output_scale: Option<OutputScale>,
    pub trained_ranges: Vec<[f32; 2]>,
    pub scores: Option<Scores>,
}

/// Source of batches.
pub(crate) enum Samples {
    Gathered(Replay),
    Pool(Pool),
}

/// The network being trained and its buffers.
pub(crate) enum Core {
    Reference(Box<CoreOf<ReferenceNetwork>>),
    Fast(Box<CoreOf<FastNetwork>>),
}

pub(crate) struct CoreOf<N: Network> {
    pub network: N,
    buffers: GradientBuffers<N>,
}

/// Report of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Steps done.
    pub step: u64,
    /// Samples done.
    pub samples: u64,
    /// Share of the configured training that is done, 0..1.
    pub progress: f32,
    /// Mean loss of this batch; on a device, of the batches up to when it was last asked. `None` if the step only gathered
    /// targets.
    pub loss: Option<f64>,
    /// Images, or blocks of samples, that are still to be gathered before training goes on.
    pub missing: usize,
    /// A pixel whose target a device has gathered and which is not finite: from here on the CPU gathers.
    pub bad_target: Option<u32>,
}

impl Trainer {
    /// Starts a training.
    ///
    /// # Errors
    /// [`ProxyError::Features`] or [`ProxyError::Config`].
    pub fn new(
        features: Arc<PixelFeatures>,
        kind: LightKind,
        config: TrainConfig,
        seed: u64,
    ) -> Result<Self, ProxyError> {
        features.validate()?;
        config.validate(kind)?;
        let normalisation = Normalisation::of(&features);
        let core = Core::new(&config, kind, normalisation, [features.width, features.height]);
        let params = core.layout().start_values(seed);
        let state = TrainState {
            optimiser: Optimiser::new(core.layout(), config.muon),
            mean: params.clone(),
            params,
            step: 0,
            samples: 0,
            output_scale: None,
            trained_ranges: Vec::new(),
            scores: None,
        };
        Ok(Self {
            scene: Arc::new(SceneCache::new(&features, normalisation)),
            samples_of: Samples::new(&config, features.pixel_count(), 0),
            isa: Isa::detect(),
            scene_hash: String::new(),
            held_out: Vec::new(),
            device: None,
            config,
            kind,
            seed,
            features,
            state,
            core,
        })
    }

    /// Replaces the state, when resuming.
    pub(crate) fn restore(&mut self, state: TrainState) {
        self.state = state;
        self.forget_samples();
    }

    /// Gathers anew what the state is to be trained on.
    pub(crate) fn forget_samples(&mut self) {
        self.samples_of = Samples::new(&self.config, self.features.pixel_count(), self.state.samples);
    }

    /// Names the scene in the files that are written.
    pub fn set_scene_hash(&mut self, hash: impl Into<String>) {
        self.scene_hash = hash.into();
    }

    /// The configuration.
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Changes the number of samples of the whole training, which stretches or shortens the rest of the schedule.
    pub fn set_samples(&mut self, samples: u64) {
        self.config.samples = samples.max(1);
    }

    /// Steps done.
    pub fn steps(&self) -> u64 {
        self.state.step
    }

    /// Samples done.
    pub fn samples(&self) -> u64 {
        self.state.samples
    }

    /// True if the configured number of samples is done. Further steps are possible, at the final rates.
    pub fn done(&self) -> bool {
        self.state.samples >= self.config.samples
    }

    /// Scores of the last [`Trainer::validate`].
    pub fn scores(&self) -> Option<Scores> {
        self.state.scores
    }

    /// One step, on a device several: draws a batch and moves the weights along its gradient. While targets are missing, a
    /// call gathers some of them instead.
    ///
    /// # Errors
    /// [`ProxyError::Diverged`], with the weights as before the step; the failure of the source or the device.
    pub fn step(&mut self, source: &dyn TargetSource) -> Result<StepReport, ProxyError> {
        if let Some(mut device) = self.device.take() {
            let report = self.steps_on_device(&mut device, source);
            self.device = Some(device);
            return report;
        }
        if !self.gather(source, false)? {
            return Ok(self.report(None));
        }
        let scale = self.calibrated(&self.sampler(), source)?;
        let done = progress(&self.config, self.state.samples);
        let samples = batch_size(&self.config, done);
        let batch = self.random_batch(&scale, samples);
        let loss = self.descend(&batch, done)?;
        self.state.samples += samples as u64;
        self.widen_ranges(&batch.lights);
        Ok(self.report(Some(loss)))
    }

    /// Gathers what is due, or leaves single pixels to be gathered on the device; false if it takes further calls.
    pub(crate) fn gather(&mut self, source: &dyn TargetSource, on_device: bool) -> Result<bool, ProxyError> {
        let sampler = self.sampler();
        let scale = self.calibrated(&sampler, source)?;
        let (seed, samples) = (self.seed, self.state.samples);
        match &mut self.samples_of {
            Samples::Gathered(replay) => {
                let size = (BLOCK as usize, self.config.lights_per_pixel);
                replay.fill(samples, seed, |key| match on_device {
                    true => Ok(sampler.drawn(source, size, key)),
                    false => sampler.gathered(source, &scale, size, key),
                })?;
                Ok(replay.missing(samples) == 0)
            }
            Samples::Pool(pool) => {
                pool.fill(&sampler, source, samples, seed)?;
                Ok(pool.missing(samples) == 0)
            }
        }
    }

    /// Moves the weights along the gradient of a batch, with the learning rates of a training of which this share is done, and
    /// returns the loss.
    ///
    /// # Errors
    /// [`ProxyError::Diverged`], with the weights as before.
    pub fn descend(&mut self, batch: &Batch, done: f32) -> Result<f64, ProxyError> {
        let state = &mut self.state;
        let context = NetworkContext { isa: self.isa, scene: &self.scene, params: &state.params };
        let (loss, layout, gradient) = self.core.gradient(context, batch);
        if !loss.is_finite() || !gradient.iter().all(|g| g.is_finite()) {
            return Err(ProxyError::Diverged { step: state.step });
        }
        state.step += 1;
        let rates = rates(&self.config, done);
        state.optimiser.update(self.isa, layout, &mut state.params, gradient, rates, state.step);
        if let Some(share) = mean_share(&self.config, state.step) {
            for (mean, param) in state.mean.iter_mut().zip(&state.params) {
                *mean += share * (param - *mean);
            }
        }
        Ok(loss)
    }

    /// The proxy as it stands, from the running mean of weights.
    ///
    /// # Errors
    /// [`ProxyError::Gpu`] if its weights are on a device that was lost.
    pub fn proxy(&self) -> Result<Proxy, ProxyError> {
        let params = self.proxy_params(&*self.whole_state()?).to_vec();
        Ok(Proxy::new(self.info(), Arc::clone(&self.features), params))
    }

    /// The weights that a proxy is made of.
    pub(crate) fn proxy_params<'a>(&self, state: &'a TrainState) -> &'a [f32] {
        let averaged = self.config.ema_decay > 0.0 && state.step >= EMA_EVERY;
        if averaged { &state.mean } else { &state.params }
    }

    /// Lights that [`Trainer::validate`] measures on.
    pub fn held_out_lights(&self) -> usize {
        self.config.held_out.max(1)
    }

    /// Gathers the images of some more lights for [`Trainer::validate`], denoised if the source can. How many were missing and
    /// are there now; none once all are.
    ///
    /// # Errors
    /// The failure of the source.
    pub fn hold_out(&mut self, source: &dyn TargetSource, at_most: usize) -> Result<usize, ProxyError> {
        let sampler = self.sampler();
        let there = self.held_out.len();
        let draw = |i| sampler.light_anywhere(source, &mut Rng::stream(self.seed, HELD_OUT_STREAM, i as u64));
        let lights: Vec<LightParams> =
            (there..self.held_out_lights().min(there + at_most)).map(draw).collect();
        if lights.is_empty() {
            return Ok(0);
        }
        let images = images_of(source, &lights, true, self.features.pixel_count())?;
        self.held_out.extend(lights.into_iter().zip(images));
        Ok(self.held_out.len() - there)
    }

    /// Measures the proxy as it stands on lights that training never sees. Images of theirs that [`Trainer::hold_out`] has not
    /// gathered are gathered first.
    ///
    /// # Errors
    /// The failure of the source.
    pub fn validate(&mut self, source: &dyn TargetSource) -> Result<Scores, ProxyError> {
        self.calibrated(&self.sampler(), source)?;
        self.hold_out(source, self.held_out_lights())?;
        let proxy = self.proxy()?;
        let mut scores = Scores { psnr: 0.0, smape: 0.0, lights: 0, samples: self.state.samples };
        for (light, reference) in &self.held_out {
            let image = proxy.unit_image(light)?;
            // Equal pictures have no finite PSNR.
            scores.psnr += metrics::psnr_reinhard(&image, reference).min(100.0) as f32;
            scores.smape += metrics::smape(&image, reference) as f32;
            scores.lights += 1;
        }
        scores.psnr /= scores.lights as f32;
        scores.smape /= scores.lights as f32;
        self.state.scores = (scores.psnr.is_finite() && scores.smape.is_finite()).then_some(scores);
        Ok(scores)
    }

    pub(crate) fn info(&self) -> ProxyInfo {
        let output_scale = self.state.output_scale.unwrap_or(OutputScale { factor: 1.0, area: None });
        ProxyInfo {
            kind: self.kind,
            network: self.config.network.clone(),
            image: [self.features.width, self.features.height],
            size: self.config.size,
            trained_ranges: self.state.trained_ranges.clone(),
            normalisation: self.scene.normalisation,
            output_scale,
            steps: self.state.step,
            samples: self.state.samples,
            held_out: self.state.scores,
            scene_hash: self.scene_hash.clone(),
        }
    }

    pub(crate) fn layout(&self) -> &ParamLayout {
        self.core.layout()
    }

    /// Sets the biases of the outputs. Most of what a network that has learned nothing puts out is cut off at zero, so that
    /// its errors as shares of its largest value say little; with a bias above zero they do not.
    ///
    /// # Panics
    /// If the training runs on a device.
    pub fn set_output_bias(&mut self, value: f32) {
        assert!(self.device.is_none(), "the weights are on a device");
        let is_of_outputs = |tensor: &&Tensor| tensor.role == Role::Bias && tensor.cols == 3;
        let biases = self.core.layout().tensors.iter().filter(is_of_outputs);
        let ranges: Vec<_> = biases.map(|tensor| tensor.start..tensor.start + 3).collect();
        ranges.into_iter().for_each(|range| self.state.params[range].fill(value));
    }

    /// Multiply-adds of one sample in training (forward only) and in inference.
    pub fn multiply_adds(&self) -> (usize, usize) {
        let slots = self.config.lights_per_pixel;
        match &self.core {
            Core::Reference(core) => core.network.multiply_adds(slots),
            Core::Fast(core) => core.network.multiply_adds(slots),
        }
    }

    /// The batch of the current step.
    pub(crate) fn random_batch(&self, scale: &OutputScale, samples: usize) -> Batch {
        let key = (self.seed, self.state.step);
        match &self.samples_of {
            Samples::Gathered(replay) => replay.batch(samples, key),
            Samples::Pool(pool) => {
                self.sampler().batch_from_pool(pool, scale, (samples, self.config.lights_per_pixel), key)
            }
        }
    }

    /// A batch as the first step would draw it.
    ///
    /// # Errors
    /// The failure of the source.
    pub fn first_batch(&mut self, source: &dyn TargetSource, samples: usize) -> Result<Batch, ProxyError> {
        while !self.gather(source, false)? {}
        let scale = self.calibrated(&self.sampler(), source)?;
        Ok(self.random_batch(&scale, samples))
    }

    pub(crate) fn report(&self, loss: Option<f64>) -> StepReport {
        StepReport {
            step: self.state.step,
            samples: self.state.samples,
            progress: progress(&self.config, self.state.samples),
            loss,
            missing: match &self.samples_of {
                Samples::Gathered(replay) => replay.missing(self.state.samples),
                Samples::Pool(pool) => pool.missing(self.state.samples),
            },
            bad_target: None,
        }
    }

    pub(crate) fn sampler(&self) -> Sampler {
        Sampler {
            kind: self.kind,
            size: self.config.size,
            placement: self.config.placement,
            area_weight: self.config.area_weight,
            pixel_count: self.features.pixel_count() as u32,
        }
    }

    /// The output scale, measured at the first call.
    fn calibrated(
        &mut self,
        sampler: &Sampler,
        source: &dyn TargetSource,
    ) -> Result<OutputScale, ProxyError> {
        if let Some(scale) = self.state.output_scale {
            return Ok(scale);
        }
        let area = self.config.scale_by_area.then(|| sampler.middling_area());
        let scale = sampler.calibrate(source, area, self.seed)?;
        self.state.output_scale = Some(scale);
        Ok(scale)
    }

    pub(crate) fn widen_ranges(&mut self, lights: &[LightParams]) {
        if self.state.trained_ranges.is_empty() {
            self.state.trained_ranges = lights[0].as_slice().iter().map(|value| [*value; 2]).collect();
        }
        for light in lights {
            for (range, value) in self.state.trained_ranges.iter_mut().zip(light.as_slice()) {
                *range = [range[0].min(*value), range[1].max(*value)];
            }
        }
    }
}

impl Samples {
    /// Empty samples, for a training that has done `samples` samples.
    fn new(config: &TrainConfig, pixel_count: usize, samples: u64) -> Self {
        match config.targets {
            TargetMode::Raw => Self::Gathered(Replay::new(config.sample_reuse, samples)),
            TargetMode::Pool { size, denoised } => {
                let samples_per_image = (config.sample_reuse * pixel_count) as u64;
                Self::Pool(Pool::new((size, denoised), samples_per_image, samples))
            }
        }
    }
}

impl Core {
    fn new(config: &TrainConfig, kind: LightKind, normalisation: Normalisation, size: [usize; 2]) -> Self {
        let light = LightEncoding::new(kind, normalisation, config.size);
        match &config.network {
            NetworkConfig::Reference { width, layers, grid } => {
                Self::Reference(CoreOf::new(ReferenceNetwork::new(*width, *layers, grid, size, light)))
            }
            NetworkConfig::Fast { width, layers, grid } => {
                Self::Fast(CoreOf::new(FastNetwork::new(*width, *layers, grid, size, light)))
            }
        }
    }

    fn layout(&self) -> &ParamLayout {
        match self {
            Self::Reference(core) => core.network.layout(),
            Self::Fast(core) => core.network.layout(),
        }
    }

    fn gradient(&mut self, context: NetworkContext<'_>, batch: &Batch) -> (f64, &ParamLayout, &[f32]) {
        match self {
            Self::Reference(core) => core.gradient(context, batch),
            Self::Fast(core) => core.gradient(context, batch),
        }
    }
}

impl<N: Network> CoreOf<N> {
    fn new(network: N) -> Box<Self> {
        let buffers = GradientBuffers::new(&network);
        Box::new(Self { network, buffers })
    }

    fn gradient(&mut self, context: NetworkContext<'_>, batch: &Batch) -> (f64, &ParamLayout, &[f32]) {
        let packed = self.network.pack(context.params);
        let loss = batch_gradient(&self.network, &packed, context, batch, &mut self.buffers);
        (loss, self.network.layout(), &self.buffers.total)
    }
}

#[cfg(test)]
mod tests;
