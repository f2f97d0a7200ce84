use std::borrow::Cow;
use std::sync::Arc;
use std::time::Instant;

use relume_gpu::{Gpu, Submission};

use super::arguments::TrainProgress;
use super::matrices::are_worth_it;
use super::pool::DevicePool;
use super::{Demand, GpuTraining, TrainStep};
use crate::network::CHUNK;
use crate::replay::{BLOCK, CAPACITY, FILL};
use crate::schedule::{batch_size, mean_share, progress, rates};
use crate::trainer::{Core, Samples, TrainState};
use crate::{DeviceTargets, ProxyError, StepReport, TargetSource, Trainer};

/// Most steps that are handed to the device at a time.
const STEPS: usize = 8;
/// Steps after which the device is asked for the loss, which waits for it.
const READ_EVERY: usize = 64;
/// Blocks of gathered samples on the device: those that are drawn from, and those that come while steps that draw from the
/// oldest are not handed over yet.
const RING: u64 = CAPACITY + STEPS as u64 * FILL;
/// Chunks of a block.
const BLOCK_CHUNKS: usize = BLOCK as usize / CHUNK;
/// Most pixels of batches from a pool of images that wait for the device.
const POOL_PIXELS: usize = 1 << 16;

/// The side of a [`Trainer`] that runs on a device.
pub(crate) struct DeviceCore {
    pub(super) training: GpuTraining,
    /// Steps that are handed over at a time.
    steps: usize,
    /// Samples of each step since the device was last asked.
    unread: Vec<u64>,
    /// Mean loss when the device was last asked.
    loss: Option<f64>,
    /// First block of gathered samples that is not there yet.
    next_block: u64,
    /// The images of a pool, if they fit there.
    pub(super) pool: Option<DevicePool>,
    /// Chunk that the next batch from a pool begins at, among those of the steps that are handed over next.
    next_chunk: usize,
    /// The steps that were handed over last.
    submitted: Option<Submission>,
    /// True if its targets are gathered on the CPU, because one of those from the device was not finite.
    distrusted: bool,
}

impl Trainer {
    /// Moves the training to a GPU, where it goes on as it would have on the CPU but for the rounding of sums. A call of
    /// [`Trainer::step`] then does several steps.
    ///
    /// Targets of single pixels are gathered there too if the source can ([`TargetSource::on_device`]), else on the CPU. If one
    /// is not finite, what was trained on it is taken back and the CPU gathers from there on ([`StepReport::bad_target`]). A pool
    /// of images is kept there and nowhere else if it takes at most half of the memory that is left, else here.
    ///
    /// If the device is lost, steps and saving fail with [`ProxyError::Gpu`]; the file of the last [`Trainer::save`] is
    /// still good, for any device or none.
    ///
    /// A network of at least 128 neurons a layer multiplies there with factors of 16 bits and sums of 32 where the device has
    /// matrices for that, and a test shows that gradients are what they should be. Weights and activations stay in 32 bits.
    ///
    /// # Errors
    /// [`ProxyError::Gpu`] if it does not fit there.
    pub fn on_gpu(self, gpu: Arc<Gpu>) -> Result<Self, ProxyError> {
        let matrices = are_worth_it(&self.config.network);
        self.on_gpu_with(gpu, matrices)
    }

    /// [`Trainer::on_gpu`] with matrices, where the device can, or without.
    fn on_gpu_with(mut self, gpu: Arc<Gpu>, matrices: bool) -> Result<Self, ProxyError> {
        let largest = self.config.batch_end.div_ceil(CHUNK);
        let (steps, chunks) = match &self.samples_of {
            Samples::Gathered(_) => (STEPS, RING as usize * BLOCK_CHUNKS),
            Samples::Pool(_) => {
                let pixels = largest * CHUNK / self.config.lights_per_pixel;
                let steps = (POOL_PIXELS / pixels).clamp(1, STEPS);
                (steps, steps * largest)
            }
        };
        let demand =
            Demand { config: &self.config, scene: &self.scene, chunks, draws: steps * largest, matrices };
        let training = match &self.core {
            Core::Reference(core) => GpuTraining::new(gpu, &core.network, &demand)?,
            Core::Fast(core) => GpuTraining::new(gpu, &core.network, &demand)?,
        };
        // From here on they live on the device.
        let state = &mut self.state;
        let [params, mean] = [&mut state.params, &mut state.mean].map(std::mem::take);
        let [first, second] = [&mut state.optimiser.first, &mut state.optimiser.second].map(std::mem::take);
        training.upload([&params, &mean, &first, &second]);
        let pool = match &self.samples_of {
            Samples::Gathered(_) => None,
            Samples::Pool(pool) => DevicePool::new(&training, pool.size(), self.features.pixel_count())?,
        };
        let mut device = DeviceCore {
            training,
            pool,
            steps,
            unread: Vec::new(),
            loss: None,
            next_block: 0,
            next_chunk: 0,
            submitted: None,
            distrusted: false,
        };
        self.upload_samples(&mut device, None)?;
        self.device = Some(Box::new(device));
        Ok(self)
    }

    /// True if it runs on a device that has no room for its pool of images, from which samples are then drawn here.
    pub fn pool_stays_on_cpu(&self) -> bool {
        matches!(self.samples_of, Samples::Pool(_))
            && self.device.as_ref().is_some_and(|device| device.pool.is_none())
    }

    /// Seconds of a training step on a device, targets not included: the best of some rounds of a few steps on the same
    /// samples. Nothing with `matrices` where the device has none.
    ///
    /// # Errors
    /// The failure of the source or the device.
    pub fn seconds_on_gpu(
        mut self,
        gpu: &Arc<Gpu>,
        source: &dyn TargetSource,
        (samples, rounds): (usize, usize),
        matrices: bool,
    ) -> Result<Option<f64>, ProxyError> {
        let batch = self.first_batch(source, samples)?;
        let trainer = self.on_gpu_with(Arc::clone(gpu), matrices)?;
        let (Some(device), Some(scale)) = (&trainer.device, &trainer.state.output_scale) else {
            return Ok(None);
        };
        if device.training.by_matrices() != matrices {
            return Ok(None);
        }
        device.training.write_chunks(0, &batch, scale);
        let step = |number| TrainStep {
            draws: (0..(samples / CHUNK) as u32).collect(),
            rates: rates(&trainer.config, 0.5),
            number,
            mean_share: mean_share(&trainer.config, number),
        };
        let mut best = f64::INFINITY;
        for round in 0..=rounds {
            let steps: Vec<TrainStep> = (1..=device.steps as u64).map(step).collect();
            let start = Instant::now();
            device.training.run(&steps)?;
            gpu.wait()?;
            // The first round is for drivers that compile on first use.
            if round > 0 {
                best = best.min(start.elapsed().as_secs_f64() / steps.len() as f64);
            }
        }
        Ok(Some(best))
    }

    /// The state with its weights, wherever they are.
    pub(crate) fn whole_state(&self) -> Result<Cow<'_, TrainState>, ProxyError> {
        let Some(device) = &self.device else { return Ok(Cow::Borrowed(&self.state)) };
        let [params, mean, first, second] = device.training.download()?;
        let mut state = TrainState { params, mean, ..self.state.clone() };
        if !device.unread.is_empty() {
            state.take_back(undone(&device.unread, &device.training.progress()?));
        }
        (state.optimiser.first, state.optimiser.second) = (first, second);
        Ok(Cow::Owned(state))
    }

    /// [`Trainer::step`] on the device.
    pub(crate) fn steps_on_device(
        &mut self,
        device: &mut DeviceCore,
        source: &dyn TargetSource,
    ) -> Result<StepReport, ProxyError> {
        let before = (self.state.step, self.state.samples);
        let targets = source.on_device().filter(|_| !device.distrusted);
        device.next_chunk = 0;
        let mut steps = Vec::new();
        let mut ready = Ok(true);
        // New images of a pool take the places of old ones, so that steps which draw from those come before.
        while steps.len() < device.steps && (steps.is_empty() || !self.done() && !self.lacks_images()) {
            ready = self.gather(source, targets.is_some());
            if !matches!(ready, Ok(true)) {
                break;
            }
            steps.push(self.next_step(device)?);
        }
        if let Err(error) = self.hand_over(device, targets, &steps) {
            (self.state.step, self.state.samples) = before;
            return Err(error);
        }
        ready?;
        let mut bad_target = None;
        if device.unread.len() >= READ_EVERY || self.done() || (device.loss.is_none() && !steps.is_empty()) {
            bad_target = self.read_progress(device)?;
        }
        Ok(StepReport { bad_target, ..self.report(device.loss.filter(|_| !steps.is_empty())) })
    }

    /// Gives the device the samples that it has not yet, and steps to do.
    fn hand_over(
        &mut self,
        device: &mut DeviceCore,
        targets: Option<&dyn DeviceTargets>,
        steps: &[TrainStep],
    ) -> Result<(), ProxyError> {
        self.upload_samples(device, targets)?;
        if !steps.is_empty() {
            if let Some(pool) = &device.pool {
                pool.take(&device.training, device.next_chunk)?;
            }
            let submission = device.training.run(steps)?;
            // At most two groups of steps wait on the device, since a picture that is asked for meanwhile waits behind them.
            if let Some(before) = device.submitted.replace(submission) {
                device.training.gpu.wait_for(before)?;
            }
            device.unread.extend(steps.iter().map(|step| (step.draws.len() * CHUNK) as u64));
        }
        Ok(())
    }

    /// True if images of a pool are to be made before the next step.
    fn lacks_images(&self) -> bool {
        matches!(&self.samples_of, Samples::Pool(pool) if pool.missing(self.state.samples) > 0)
    }

    /// Copies new blocks of samples, or images, to the device; blocks without targets are gathered there.
    fn upload_samples(
        &mut self,
        device: &mut DeviceCore,
        targets: Option<&dyn DeviceTargets>,
    ) -> Result<(), ProxyError> {
        let sampler = self.sampler();
        let Some(scale) = &self.state.output_scale else { return Ok(()) };
        let replay = match (&mut self.samples_of, &device.pool) {
            (Samples::Gathered(replay), _) => replay,
            (Samples::Pool(images), Some(pool)) => {
                for (number, light, image) in images.take_images() {
                    let row = device.training.store.light_row(&light, sampler.weight(&light), scale);
                    pool.put(&device.training, (number, &image), &row)?;
                }
                return Ok(());
            }
            (Samples::Pool(_), None) => return Ok(()),
        };
        let new = || replay.blocks().filter(|(number, _)| *number >= device.next_block);
        new().for_each(|(number, block)| device.training.write_chunks(ring_chunk(number), block, scale));
        let mut bare = new().filter(|(_, block)| block.targets.is_empty()).peekable();
        if let Some((first, _)) = bare.peek() {
            let first = (first % RING) as usize;
            let blocks: Vec<_> = bare.map(|(_, block)| block).collect();
            let targets =
                targets.ok_or_else(|| ProxyError::targets("the source is no longer on the device"))?;
            device.training.gather(targets, first, &blocks)?;
        }
        device.next_block = replay.next_block();
        Ok(())
    }

    /// Counts the next step, and says what it takes.
    fn next_step(&mut self, device: &mut DeviceCore) -> Result<TrainStep, ProxyError> {
        let done = progress(&self.config, self.state.samples);
        let samples = batch_size(&self.config, done);
        let draws = self.draws(device, samples)?;
        self.state.step += 1;
        self.state.samples += samples as u64;
        let number = self.state.step;
        Ok(TrainStep {
            draws,
            rates: rates(&self.config, done),
            number,
            mean_share: mean_share(&self.config, number),
        })
    }

    /// The chunks of the next step.
    fn draws(&mut self, device: &mut DeviceCore, samples: usize) -> Result<Vec<u32>, ProxyError> {
        let key = (self.seed, self.state.step);
        if let Samples::Gathered(replay) = &self.samples_of {
            let drawn: Vec<(u64, usize)> = replay.draw(samples, key).collect();
            let lights: Vec<_> = drawn.iter().flat_map(|draw| replay.lights(*draw)).copied().collect();
            self.widen_ranges(&lights);
            return Ok(drawn.iter().map(|(number, chunk)| (ring_chunk(*number) + chunk) as u32).collect());
        }
        let first = device.next_chunk;
        device.next_chunk += samples / CHUNK;
        if let (Samples::Pool(images), Some(pool)) = (&self.samples_of, &device.pool) {
            let size = (samples, self.config.lights_per_pixel);
            let (pixels, numbers) = self.sampler().drawn_from_pool(images, size, key);
            pool.write_chunks(&device.training, first, &pixels, &numbers);
            let lights: Vec<_> = numbers.iter().map(|&number| images.entry(number).light).collect();
            self.widen_ranges(&lights);
        } else {
            let scale = self.state.output_scale.ok_or_else(|| {
                ProxyError::Config("the scale of outputs is not known before targets are".to_owned())
            })?;
            let batch = self.random_batch(&scale, samples);
            device.training.write_chunks(first, &batch, &scale);
            self.widen_ranges(&batch.lights);
        }
        Ok((first as u32..device.next_chunk as u32).collect())
    }

    /// Asks the device how it went. After a bad target, whose pixel comes back, samples are gathered anew on the CPU.
    fn read_progress(&mut self, device: &mut DeviceCore) -> Result<Option<u32>, ProxyError> {
        let progress = device.training.progress()?;
        device.training.forget_progress();
        let unread = std::mem::take(&mut device.unread);
        device.loss = (progress.steps > 0).then(|| f64::from(progress.loss_sum) / f64::from(progress.steps));
        self.state.take_back(undone(&unread, &progress));
        if let Some(pixel) = progress.bad_target.checked_sub(1) {
            device.distrusted = true;
            device.next_block = 0;
            self.forget_samples();
            return Ok(Some(pixel));
        }
        if progress.diverged == 0 {
            return Ok(None);
        }
        device.loss = None;
        Err(ProxyError::Diverged { step: self.state.step })
    }
}

/// Samples of the steps, of those that were last handed over, that had no effect: all from the first bad one on.
fn undone<'a>(unread: &'a [u64], progress: &TrainProgress) -> &'a [u64] {
    let done = if progress.diverged == 0 { unread.len() } else { progress.steps as usize };
    &unread[done.min(unread.len())..]
}

impl TrainState {
    /// Forgets that steps of so many samples each were done.
    fn take_back(&mut self, steps: &[u64]) {
        self.step -= steps.len() as u64;
        self.samples -= steps.iter().sum::<u64>();
    }
}

/// First chunk on the device of a block of the replay.
fn ring_chunk(number: u64) -> usize {
    (number % RING) as usize * BLOCK_CHUNKS
}
