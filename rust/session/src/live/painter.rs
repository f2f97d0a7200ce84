use super::gathered::Clean;
use super::parts::{How, Part, parts};
use super::picture::{Manner, Picture, noise};
use super::shared::{Frame, LiveState, Shared, Shown, State};
use super::units::Units;
use super::view::{Delivered, SharedImage, View, shown_statics};
use super::world::WorldUnit;
use super::{Aov, LiveOptions, LiveRequest};
use crate::bake::world::forget;
use crate::device::compute::Compute;
use crate::device::image::DeviceImage;
use crate::device::threads::beside_window;
use crate::error::SessionError;
use crate::progress::{Cancel, Listener, Monitor, Progress};
use crate::relight::relighter::With;
use relume_image::Image;
use relume_scene::Light;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, MutexGuard};
use std::time::{Duration, Instant};

/// How long a light that is being dragged is gathered before it is shown.
const DRAG_BUDGET: Duration = Duration::from_millis(60);
/// How often a picture that is still growing is shown.
const SHOW_EVERY: Duration = Duration::from_millis(400);
/// Pictures of a drag that take longer are made at half the size, and shorter ones at full size again.
const SLOW: Duration = Duration::from_millis(50);
const QUICK: Duration = Duration::from_millis(12);

/// The thread that makes pictures of what the work delivers under the newest request.
pub(super) struct Painter {
    shared: Arc<Shared>,
    options: LiveOptions,
    compute: Compute,
    monitor: Monitor,
    view: Option<View>,
    units: Units,
    /// The world that is shown in place of the paths' own.
    world: Option<WorldUnit>,
    /// Bake folder that the light of such a world is stored in.
    folder: Option<PathBuf>,
    /// Request and delivery that were painted last.
    painted: (u64, u64),
    serial: u64,
    /// Whether nothing of this bake was shown yet.
    first_frame: bool,
    /// 1, or 2 on machines that are too slow for the full size in a drag.
    drag_scale: usize,
}

/// What the painter's helpers have to say goes to the status.
struct Notes(Arc<Shared>);

impl Listener for Notes {
    fn progress(&self, _: &Progress) {}

    fn warning(&self, message: &str) {
        self.0.warn(message);
    }
}

impl Painter {
    pub fn new(shared: Arc<Shared>, options: LiveOptions) -> Self {
        let monitor = Monitor::new(Arc::new(Notes(shared.clone())), Cancel::default());
        let compute = Compute::default();
        let (units, painted) = (Units::default(), (0, 0));
        Self {
            shared,
            options,
            compute,
            monitor,
            view: None,
            units,
            world: None,
            folder: None,
            painted,
            serial: 0,
            first_frame: true,
            drag_scale: 1,
        }
    }

    /// The same on a device that is open.
    #[cfg(test)]
    pub fn on(self, compute: Compute) -> Self {
        Self { compute, ..self }
    }

    /// The same, that stores the light of another world in a bake folder.
    pub fn storing_in(self, folder: &Path) -> Self {
        Self { folder: Some(folder.to_path_buf()), ..self }
    }

    /// Paints until the shot is closed.
    pub fn run(mut self) {
        let threads = self.options.threads;
        let outcome = catch_unwind(AssertUnwindSafe(|| beside_window(threads, || self.paint_until_closed())));
        if outcome.is_err() {
            self.shared.change(|state| {
                state.painting = false;
                state.picture_error = Some("internal error while painting; please report it".into());
            });
        }
    }

    fn paint_until_closed(&mut self) {
        match self.options.device.open(self.options.gpu_memory) {
            Ok(compute) => {
                compute.warn(&self.monitor);
                self.compute = compute;
            }
            Err(error) => self.monitor.warn(&format!("{error}; pictures are made on the CPU")),
        }
        let device = self.device_in_words();
        self.shared.change(|state| state.status.device = device);
        while self.paint_next() {}
    }

    /// Waits for something new and paints it; false once the shot is closed.
    pub fn paint_next(&mut self) -> bool {
        let Some(request) = self.next() else { return false };
        let outcome = self.paint(&request);
        self.shared.change(|state| {
            state.painting = false;
            state.picture_error = outcome.err().map(|error| error.to_string());
        });
        true
    }

    fn device_in_words(&self) -> String {
        match &self.compute.gpu {
            Some(gpu) => gpu.summary().name.clone(),
            None => format!("CPU, {} threads", rayon::current_num_threads()),
        }
    }

    /// Waits for something new and takes it over; nothing once the shot is closed.
    fn next(&mut self) -> Option<Arc<LiveRequest>> {
        let shared = self.shared.clone();
        loop {
            let painted = self.painted;
            let mut state = shared.wait_while(|state| !is_new(state, painted));
            if state.closed {
                return None;
            }
            let request = state.request.clone()?;
            self.painted = (state.requests, state.deliveries);
            state.painting = true;
            let works = state.status.state.is_working();
            let world = state.world.clone();
            if self.view.as_ref().is_none_or(|view| view.deliveries != state.deliveries) {
                self.renew_view(state);
            }
            if let Some(view) = &mut self.view {
                let before = self.world.take();
                self.world = world.map(|world| WorldUnit::of(world, view, before));
                match works {
                    true => view.share_machine(),
                    false => view.rest(&self.compute),
                }
                return Some(request);
            }
        }
    }

    fn renew_view(&mut self, mut state: MutexGuard<State>) {
        let delivered = Delivered::take(&mut state);
        drop(state);
        let before = self.view.take();
        let known = before.as_ref().map(|view| view.bake.clone());
        let new_proxies = delivered.proxies.is_some();
        self.view = View::new(delivered, &self.compute, before);
        if known != self.view.as_ref().map(|view| view.bake.clone()) {
            self.units = Units::default();
            self.first_frame = true;
        } else if new_proxies {
            self.units.clear_proxies();
        }
    }

    /// Makes pictures for a request. Where the GPU fails that units are on, once more without those.
    fn paint(&mut self, request: &LiveRequest) -> Result<(), SessionError> {
        match self.try_paint(request) {
            Err(error) if error.is_of_gpu() && self.units.leave_gpu() => self.try_paint(request),
            outcome => outcome,
        }
    }

    fn try_paint(&mut self, request: &LiveRequest) -> Result<(), SessionError> {
        let Some(mut view) = self.view.take() else { return Ok(()) };
        if let Some(aov) = request.aov {
            self.show_aov(aov, &view);
            self.view = Some(view);
            return Ok(());
        }
        let (parts, mut told) = parts(request, &mut view);
        self.units.trim(&parts.iter().map(|part| part.light.clone()).collect::<Vec<_>>());
        // Starting a denoiser of the full size denoises its features, which takes longer than all of the first picture.
        let scale = if self.first_frame && view.can_be_halved() { 2 } else { 1 };
        told.warnings.extend(view.denoise(scale).missing());
        self.shared.change(|state| {
            state.light_warnings = told.warnings;
            state.status.rarely_met = told.rarely_met;
        });
        let outcome = if request.interactive {
            self.paint_drag(request, &view, &parts)
        } else {
            self.paint_still(request, &mut view, &parts)
        };
        self.view = Some(view);
        outcome
    }

    /// As much as there is time for, once.
    fn paint_drag(&mut self, request: &LiveRequest, view: &View, parts: &[Part]) -> Result<(), SessionError> {
        let start = Instant::now();
        let replaced = |part: &&Part| {
            let proxied =
                request.with != With::Gather && view.proxies.proxies().knowing(&part.light).is_some();
            part.how == How::Proxy
                || part.how == How::Gather
                    && (proxied || self.units.get(&part.light).is_some_and(|unit| unit.gathered.has_clean()))
        };
        let wanted = |number: usize, part: &Part| match part.how {
            How::Glimpse => self.is_waiting(request, view, &parts[number + 1], true),
            _ => !replaced(&part),
        };
        let new = lights(parts, wanted);
        while self.advance(&new, view)? {
            if self.units.all_begun(&new) && start.elapsed() > DRAG_BUDGET {
                break;
            }
        }
        let wanted = request.half.map_or(self.drag_scale, |half| if half { 2 } else { 1 });
        let scale = if view.can_be_halved() { wanted } else { 1 };
        self.show(request, view, parts, Manner { scale, drag: true })?;
        let took = start.elapsed();
        if took > SLOW {
            self.drag_scale = 2;
        } else if took < QUICK {
            self.drag_scale = 1;
        }
        Ok(())
    }

    /// Everything that the paths so far can give, shown as it grows; first with all noise denoised at once, then light by
    /// light, so that later edits of colour and strength only sum.
    fn paint_still(
        &mut self,
        request: &LiveRequest,
        view: &mut View,
        parts: &[Part],
    ) -> Result<(), SessionError> {
        let gathered = self.gathered(request, view, parts);
        let full = Manner { scale: 1, drag: false };
        let mut last_shown = Instant::now();
        while self.advance(&self.gathered(request, view, parts), view)? {
            if self.is_outdated() {
                return Ok(());
            }
            let begun = self.units.all_begun(&gathered);
            if begun && self.first_frame && view.can_be_halved() {
                // A quarter of the pixels is denoised in a quarter of the time.
                self.show(request, view, parts, Manner { scale: 2, drag: false })?;
                last_shown = Instant::now();
            } else if begun && last_shown.elapsed() > SHOW_EVERY {
                self.show(request, view, parts, full)?;
                last_shown = Instant::now();
            }
        }
        let settled = self.show(request, view, parts, full)?;
        // The rest is for later edits; work goes on meanwhile.
        self.shared.change(|state| state.painting = false);
        if !settled && self.refine(view, parts)? {
            self.show(request, view, parts, full)?;
        }
        self.store_world(view);
        Ok(())
    }

    /// Lights that are summed over all paths, and those of which a glimpse is wanted.
    fn gathered(&self, request: &LiveRequest, view: &View, parts: &[Part]) -> Vec<Light> {
        let is_begun = |part: &Part| self.units.get(&part.light).is_some_and(|unit| unit.gathered.passes > 0);
        lights(parts, |number, part| match part.how {
            How::Gather | How::View => true,
            How::Glimpse => !is_begun(part) && self.is_waiting(request, view, &parts[number + 1], false),
            How::Proxy => false,
        })
    }

    /// Whether a proxy stands in for what is still to be summed.
    fn is_waiting(&self, request: &LiveRequest, view: &View, part: &Part, drag: bool) -> bool {
        let is_there = self.units.get(&part.light).is_some_and(|unit| {
            unit.gathered.passes >= view.passes.len() || (drag && unit.gathered.has_clean())
        });
        part.how == How::Gather
            && !is_there
            && request.with != With::Gather
            && view.proxies.proxies().knowing(&part.light).is_some()
    }

    /// Gathers one more pass of another world and of some of the lights; false if none is behind.
    fn advance(&mut self, lights: &[Light], view: &View) -> Result<bool, SessionError> {
        let world = match &mut self.world {
            Some(world) => world.advance(view, &self.compute, &self.monitor)?,
            None => false,
        };
        Ok(self.units.advance(lights, view, &self.compute, &self.monitor)? || world)
    }

    /// Stores the light of another world for when the bake is opened again, once no more paths are to be expected.
    fn store_world(&mut self, view: &View) {
        let (Some(world), Some(folder)) = (&mut self.world, &self.folder) else { return };
        let may_store =
            |state: &State| state.status.state != LiveState::Baking && world.is_of(state.world.as_ref());
        if !may_store(&self.shared.lock()) {
            return;
        }
        let stored = world.store(view, folder);
        if let Err(error) = &stored {
            self.monitor.warn(&error.to_string());
        }
        let mut forgotten = Ok(());
        self.shared.change(|state| {
            if world.is_of(state.world.as_ref()) {
                state.status.world_is_stored = stored.is_ok_and(|stored| stored);
            } else {
                forgotten = forget(folder);
            }
        });
        // Not before the lock is free, which a warning takes.
        if let Err(error) = forgotten {
            self.monitor.warn(&error.to_string());
        }
    }

    /// Denoises what is stale, one picture at a time; false if something newer came up.
    fn refine(&mut self, view: &mut View, parts: &[Part]) -> Result<bool, SessionError> {
        let (denoise, quality) = (&view.denoise[0], view.quality);
        let stop = || is_new(&self.shared.lock(), self.painted);
        let clean = |noisy: &DeviceImage| -> Result<Option<Clean>, SessionError> {
            let mut image = noisy.read()?;
            let done = denoise.images_until(std::slice::from_mut(&mut image), quality, &stop)?;
            Ok(done.then(|| Clean { image: DeviceImage::beside(noisy, image), quality }))
        };
        for part in parts.iter().filter(|part| part.how == How::Gather) {
            let gathered = &mut self.units.of(&part.light).gathered;
            if !gathered.is_done(quality) {
                let Some(clean) = clean(&gathered.mean)? else { return Ok(false) };
                gathered.clean = Some((gathered.passes, clean));
            }
        }
        if let Some(world) = self.world.as_mut().filter(|world| !world.is_done(quality)) {
            let Some(clean) = clean(&world.gathered.mean)? else { return Ok(false) };
            world.gathered.clean = Some((world.gathered.passes, clean));
        }
        let shown = shown_statics(self.world.is_some());
        for layer in view.statics[shown].iter_mut().filter(|layer| !layer.is_done(quality)) {
            let Some(clean) = clean(&layer.image)? else { return Ok(false) };
            layer.clean = Some(clean);
        }
        Ok(true)
    }

    /// Whether another picture is asked for.
    fn is_outdated(&self) -> bool {
        let state = self.shared.lock();
        state.closed || state.requests != self.painted.0
    }

    /// Sums, denoises what is noisy, and hands the frame over. True if nothing in it was noisy.
    fn show(
        &mut self,
        request: &LiveRequest,
        view: &View,
        parts: &[Part],
        manner: Manner,
    ) -> Result<bool, SessionError> {
        let stand_ins = self.stand_ins(request, view, parts, manner)?;
        let units = (&self.units, self.world.as_ref());
        let picture = Picture::new(request, view, units, parts, &stand_ins, manner);
        let image = picture.image(view, manner)?;
        self.first_frame = false;
        let denoised = view.denoise(manner.scale).missing().is_none();
        // Without a denoiser nothing gets better than it is.
        let settled = picture.is_best || !denoised;
        let noise =
            if settled && !manner.drag { noise(request, units, parts, &stand_ins, &image)? } else { None };
        let (scale, samples, makers) = (manner.scale, picture.samples, picture.makers);
        self.hand_over(image, |shown| Shown { scale, samples, makers, denoised, settled, noise, ..shown });
        Ok(settled)
    }

    /// Surfaces as the paths have met them, whatever the lights are.
    fn show_aov(&mut self, aov: Aov, view: &View) {
        let samples = view.samples();
        self.hand_over(aov.image(&view.aovs), |shown| Shown { samples, ..shown });
    }

    /// The newest frame is this picture. `describe` changes what is said of it: that it is of the full size and all there is to come.
    fn hand_over(&mut self, image: Image, describe: impl FnOnce(Shown) -> Shown) {
        self.serial += 1;
        let shown = describe(Shown {
            serial: self.serial,
            request: self.painted.0,
            scale: 1,
            samples: 0,
            makers: BTreeMap::new(),
            denoised: false,
            settled: true,
            noise: None,
            deliveries: self.painted.1,
        });
        let frame = Arc::new(Frame { image, shown: shown.clone() });
        self.shared.change(|state| {
            state.frame = Some(frame);
            state.status.shown = Some(shown);
        });
    }

    /// What proxies say, for the parts that are theirs, and for those that wait for more paths.
    fn stand_ins(
        &mut self,
        request: &LiveRequest,
        view: &View,
        parts: &[Part],
        manner: Manner,
    ) -> Result<Vec<Option<SharedImage>>, SessionError> {
        let mut images = Vec::with_capacity(parts.len());
        for part in parts {
            let waits = self.is_waiting(request, view, part, manner.drag);
            let unit = self.units.of(&part.light);
            let evaluate = |half| match half {
                true => Ok(DeviceImage::Cpu(view.proxies.half_image(&part.light)?)),
                false => view.proxies.device_image(&part.light, &self.compute, &self.monitor),
            };
            let half = manner.scale == 2 && self.compute.gpu.is_none();
            let needed = part.how == How::Proxy || waits;
            images.push(needed.then(|| unit.proxied(half, evaluate)).transpose()?);
        }
        Ok(images)
    }
}

/// Of some parts, by their numbers.
fn lights(parts: &[Part], wanted: impl Fn(usize, &Part) -> bool) -> Vec<Light> {
    let wanted = parts.iter().enumerate().filter(|(number, part)| wanted(*number, part));
    wanted.map(|(_, part)| part.light.clone()).collect()
}

/// Whether there is something that was not painted yet.
fn is_new(state: &State, painted: (u64, u64)) -> bool {
    let something = state.dump.is_some() || state.base.is_some();
    state.closed || something && state.request.is_some() && (state.requests, state.deliveries) != painted
}
