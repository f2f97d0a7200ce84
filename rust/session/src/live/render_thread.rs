mod drag;
mod pace;
mod rest;

pub(super) use self::pace::DragPace;
use super::board::{Seat, Stage, Turn};
use super::layers::{FrameLayers, FrameQuality, noise};
use super::shared::{Frame, Shared, Shown, State};
use super::terms::{LightTerm, TermSource, light_terms};
use super::view::{BakeView, Delivered};
use super::world::WorldUnit;
use super::{Aov, LiveOptions, LiveRequest};
use crate::device::compute::Compute;
use crate::device::gather::{DeviceGather, Haste};
use crate::device::image::DeviceImage;
use crate::device::threads::beside_window;
use crate::error::SessionError;
use crate::progress::{Cancel, Listener, Monitor, Progress};
use crate::relight::source::Method;
use crate::relight::units::{SharedImage, UnitCache};
use relume_image::Image;
use relume_scene::Light;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, MutexGuard};
use std::time::{Duration, Instant};

/// Time between pictures of one that still grows.
const SHOW_EVERY: Duration = Duration::from_millis(400);
/// Thread that renders what the work delivers under the newest request.
pub(super) struct RenderThread {
    shared: Arc<Shared>,
    seat: Arc<Seat>,
    /// Held while something is made.
    turn: Option<Turn>,
    options: LiveOptions,
    compute: Compute,
    monitor: Monitor,
    view: Option<BakeView>,
    units: UnitCache,
    /// World that is shown in place of the paths' own.
    world: Option<WorldUnit>,
    /// Bake folder that stores the light of such a world.
    folder: Option<PathBuf>,
    /// Request and delivery that were rendered last.
    rendered: (u64, u64),
    serial: u64,
    /// True until something of this bake was shown.
    first_frame: bool,
    pace: DragPace,
    /// Memory of a frame's sum, from one frame to the next.
    sum: Image,
}

/// Listener that passes warnings on to the status.
struct StatusListener(Arc<Shared>);

impl Listener for StatusListener {
    fn progress(&self, _: &Progress) {}

    fn warning(&self, message: &str) {
        self.0.warn(message);
    }
}

impl RenderThread {
    pub fn new(shared: Arc<Shared>, options: LiveOptions, seat: Arc<Seat>) -> Self {
        let monitor = Monitor::new(Arc::new(StatusListener(shared.clone())), Cancel::default());
        let compute = Compute::default();
        let (units, rendered) = (UnitCache::default(), (0, 0));
        Self {
            shared,
            seat,
            turn: None,
            options,
            compute,
            monitor,
            view: None,
            units,
            world: None,
            folder: None,
            rendered,
            serial: 0,
            first_frame: true,
            pace: DragPace::default(),
            sum: Image::default(),
        }
    }

    /// Sets a device that is open.
    #[cfg(test)]
    pub fn on(self, compute: Compute) -> Self {
        Self { compute, ..self }
    }

    /// Sets how good pictures of a drag are.
    #[cfg(test)]
    pub fn with_pace(self, pace: DragPace) -> Self {
        Self { pace, ..self }
    }

    /// Sets the bake folder in which the light of another world is stored.
    pub fn storing_in(self, folder: &Path) -> Self {
        Self { folder: Some(folder.to_path_buf()), ..self }
    }

    /// Renders until the shot is closed.
    pub fn run(mut self) {
        let threads = self.options.threads;
        let outcome =
            catch_unwind(AssertUnwindSafe(|| beside_window(threads, || self.render_until_closed())));
        if outcome.is_err() {
            self.shared.change(|state| {
                state.rendering = false;
                state.picture_error = Some("internal error while rendering; please report it".into());
            });
        }
    }

    fn render_until_closed(&mut self) {
        match self.options.device.open(self.options.gpu_memory) {
            Ok(compute) => {
                compute.warn(&self.monitor);
                self.compute = compute;
            }
            Err(error) => self.monitor.warn(&format!("{error}; pictures are made on the CPU")),
        }
        let device = self.device_in_words();
        self.shared.change(|state| state.status.device = device);
        while self.render_next() {}
    }

    /// Waits for something new and a turn, and renders it; false once the shot is closed.
    pub fn render_next(&mut self) -> bool {
        let Some(stage) = self.wait() else { return false };
        if !self.next_turn(stage) {
            return false;
        }
        if let Some(request) = self.next() {
            let outcome = self.render(&request);
            self.shared.change(|state| {
                state.rendering = false;
                state.picture_error = outcome.err().map(|error| error.to_string());
            });
        }
        self.turn = None;
        true
    }

    /// Ends a turn and waits for the next one; false if the shot was closed meanwhile.
    fn next_turn(&mut self, stage: Stage) -> bool {
        self.turn = None;
        self.turn = self.seat.turn(stage, || self.shared.lock().closed);
        self.turn.is_some()
    }

    fn device_in_words(&self) -> String {
        match &self.compute.gpu {
            Some(gpu) => gpu.summary().name.clone(),
            None => format!("CPU, {} threads", rayon::current_num_threads()),
        }
    }

    /// Waits for something new; none once the shot is closed.
    fn wait(&self) -> Option<Stage> {
        let state = self.shared.wait_while(|state| !has_news(state, self.rendered));
        if state.closed {
            return None;
        }
        Some(if state.request.as_ref()?.interactive { Stage::Drag } else { Stage::First })
    }

    /// Takes over what is new; none if there is no picture of it.
    fn next(&mut self) -> Option<Arc<LiveRequest>> {
        let shared = self.shared.clone();
        let mut state = shared.lock();
        let request = state.request.clone()?;
        self.rendered = (state.requests, state.deliveries);
        state.rendering = true;
        let works = state.status.state.is_working();
        let world = state.world.clone();
        if self.view.as_ref().is_none_or(|view| view.deliveries != state.deliveries) {
            self.renew_view(state);
        }
        let Some(view) = &mut self.view else {
            shared.change(|state| state.rendering = false);
            return None;
        };
        let before = self.world.take();
        self.world = world.map(|world| WorldUnit::of(world, view, before));
        match works {
            true => view.share_machine(),
            false => view.prepare_for_rest(&self.compute),
        }
        Some(request)
    }

    fn renew_view(&mut self, mut state: MutexGuard<State>) {
        let delivered = Delivered::take(&mut state);
        drop(state);
        let before = self.view.take();
        let about = |view: &BakeView| (view.bake.clone(), view.connections.as_ref().map(Arc::as_ptr));
        let known = before.as_ref().map(about);
        let new_proxies = delivered.proxies.is_some();
        self.view = BakeView::new(delivered, &self.compute, before);
        let now = self.view.as_ref().map(about);
        if known != now {
            self.units = UnitCache::default();
            self.first_frame |= known.map(|(bake, _)| bake) != now.map(|(bake, _)| bake);
        } else if new_proxies {
            self.units.clear_proxies();
        }
    }

    /// Renders a request. If the GPU fails that holds units, it tries once more without those.
    fn render(&mut self, request: &LiveRequest) -> Result<(), SessionError> {
        match self.try_render(request) {
            Err(error) if error.is_of_gpu() && self.units.leave_gpu() => self.try_render(request),
            Err(SessionError::Cancelled) => Ok(()),
            outcome => outcome,
        }
    }

    fn try_render(&mut self, request: &LiveRequest) -> Result<(), SessionError> {
        let Some(mut view) = self.view.take() else { return Ok(()) };
        if let Some(aov) = request.aov {
            self.show_aov(aov, &view);
            self.view = Some(view);
            return Ok(());
        }
        let (terms, mut notes) = light_terms(request, &view);
        let needed: Vec<Light> = terms.iter().map(|term| term.light.clone()).collect();
        self.units.trim(&needed, self.seat.members());
        // Starting a denoiser of the full size denoises its features, which takes longer than all of the first picture.
        let scale = if self.first_frame && view.can_be_halved() { 2 } else { 1 };
        notes.warnings.extend(view.denoise(scale).missing());
        self.shared.change(|state| {
            state.light_warnings = notes.warnings;
            state.status.rarely_met = notes.under_sampled;
        });
        let outcome = if request.interactive {
            self.render_drag(request, &view, &terms)
        } else {
            self.render_still(request, &mut view, &terms)
        };
        self.view = Some(view);
        outcome
    }

    /// Renders a picture at rest, shown as it grows. At first all noise is denoised at once, then light by light: later
    /// edits of colour and strength are only sums.
    fn render_still(
        &mut self,
        request: &LiveRequest,
        view: &mut BakeView,
        terms: &[LightTerm],
    ) -> Result<(), SessionError> {
        self.pace.rest();
        let gathered = self.gathered(request, view, terms);
        let full = FrameQuality { scale: 1, is_drag: false };
        let (mut last_shown, mut stage) = (Instant::now(), Stage::First);
        let (shared, rendered) = (self.shared.clone(), self.rendered);
        let stop = move || is_outdated(&shared.lock(), rendered);
        loop {
            let lights = self.gathered(request, view, terms);
            let has_advanced = self.advance(&lights, view, Haste::Until(&stop))?;
            if !(has_advanced || self.connect(&lights, view, &stop)?) {
                break;
            }
            if self.is_outdated() {
                return Ok(());
            }
            let begun = self.units.all_begun(&gathered);
            let is_first = self.first_frame && view.can_be_halved();
            if begun && (is_first || last_shown.elapsed() > SHOW_EVERY) {
                // A quarter of the pixels is denoised in a quarter of the time.
                let scale = if is_first { 2 } else { 1 };
                self.show(request, view, terms, FrameQuality { scale, ..full })?;
                (last_shown, stage) = (Instant::now(), Stage::Refine);
            }
            if !self.next_turn(stage) {
                return Ok(());
            }
        }
        let settled = self.show(request, view, terms, full)?;
        // The rest is for later edits; work goes on meanwhile.
        self.shared.change(|state| state.rendering = false);
        if !settled && self.refine(view, terms)? {
            self.show(request, view, terms, full)?;
        }
        self.store_world(view);
        Ok(())
    }

    /// Lights that are summed over all paths, and those whose direct view is needed at once.
    fn gathered(&self, request: &LiveRequest, view: &BakeView, terms: &[LightTerm]) -> Vec<Light> {
        let is_begun = |term: &LightTerm| self.units.passes(&term.light) > 0;
        lights(terms, |number, term| match term.source {
            TermSource::Gather | TermSource::DirectView => true,
            TermSource::FirstView => {
                !is_begun(term) && self.is_waiting(request, view, &terms[number + 1], false)
            }
            TermSource::Proxy => false,
        })
    }

    /// True if a proxy stands in for a sum that is not complete, and not connected.
    fn is_waiting(&self, request: &LiveRequest, view: &BakeView, term: &LightTerm, drag: bool) -> bool {
        let is_there = self.units.get(&term.light).is_some_and(|unit| {
            let is_whole = unit.gathered.passes >= view.passes.len();
            is_whole || unit.gathered.connected_levels().is_some() || (drag && unit.gathered.has_clean())
        });
        term.source == TermSource::Gather
            && !is_there
            && request.method != Method::Gather
            && view.proxies.proxies().knowing(&term.light).is_some()
    }

    /// Gathers one more pass of another world and of some of the lights; false if none is behind.
    fn advance(&mut self, lights: &[Light], view: &BakeView, haste: Haste<'_>) -> Result<bool, SessionError> {
        let world = match &mut self.world {
            Some(world) => world.advance(view, &self.compute, &self.monitor)?,
            None => false,
        };
        let gather = |pass: &DeviceGather, lights: &[Light]| {
            pass.unit_parts(lights, haste, &self.compute, &self.monitor)
        };
        Ok(self.units.advance(lights, &view.passes, gather)? || world)
    }

    /// Connects some of the lights to the vertices of one level more; false if none is behind.
    fn connect(
        &mut self,
        lights: &[Light],
        view: &BakeView,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<bool, SessionError> {
        let Some(pass) = view.passes.first() else { return Ok(false) };
        let levels = view.connections.as_ref().map_or(0, |connections| connections.ready());
        let connect = |lights: &[Light], levels| pass.connected(lights, levels, stop);
        self.units.refine(lights, levels.min(view.passes.len()), connect)
    }

    /// True if another picture is asked for.
    fn is_outdated(&self) -> bool {
        is_outdated(&self.shared.lock(), self.rendered)
    }

    /// Sums, denoises what is noisy, and publishes the frame. True if nothing in it was noisy.
    fn show(
        &mut self,
        request: &LiveRequest,
        view: &BakeView,
        terms: &[LightTerm],
        quality: FrameQuality,
    ) -> Result<bool, SessionError> {
        let stand_ins = self.stand_ins(request, view, terms, quality)?;
        let units = (&self.units, self.world.as_ref());
        let layers = FrameLayers::new(request, view, units, terms, &stand_ins, quality);
        let image = layers.image(view, quality, &mut self.sum)?;
        self.first_frame = false;
        let denoised = view.denoise(quality.scale).missing().is_none();
        // Without a denoiser nothing gets better than it is.
        let settled = layers.is_best || !denoised;
        let noise = if settled && !quality.is_drag {
            noise(request, units, terms, &stand_ins, (view.film, &image))?
        } else {
            None
        };
        let (scale, samples, sources) = (quality.scale, layers.samples, layers.sources);
        self.publish(image, |shown| Shown { scale, samples, sources, denoised, settled, noise, ..shown });
        Ok(settled)
    }

    /// Shows surfaces as the paths met them, whatever the lights are.
    fn show_aov(&mut self, aov: Aov, view: &BakeView) {
        let samples = view.samples();
        self.publish(aov.image(&view.film.features(&view.aovs)), |shown| Shown { samples, ..shown });
    }

    /// Publishes a frame. `describe` changes its defaults: full size, and nothing better to come.
    fn publish(&mut self, image: Image, describe: impl FnOnce(Shown) -> Shown) {
        self.serial += 1;
        let shown = describe(Shown {
            serial: self.serial,
            request: self.rendered.0,
            scale: 1,
            samples: 0,
            sources: BTreeMap::new(),
            denoised: false,
            settled: true,
            noise: None,
            deliveries: self.rendered.1,
        });
        let frame = Arc::new(Frame { image, shown: shown.clone() });
        self.shared.change(|state| {
            state.frame = Some(frame);
            state.status.shown = Some(shown);
        });
    }

    /// Answers of proxies, for their own terms and for those that wait for more paths.
    fn stand_ins(
        &mut self,
        request: &LiveRequest,
        view: &BakeView,
        terms: &[LightTerm],
        quality: FrameQuality,
    ) -> Result<Vec<Option<SharedImage>>, SessionError> {
        let mut images = Vec::with_capacity(terms.len());
        for term in terms {
            let waits = self.is_waiting(request, view, term, quality.is_drag);
            let unit = self.units.of(&term.light);
            let evaluate = |half| match half {
                true => Ok(DeviceImage::Cpu(view.proxies.half_image(&term.light)?)),
                false => view.proxies.device_image(&term.light, &self.compute, &self.monitor),
            };
            let half = quality.scale == 2 && self.compute.gpu.is_none();
            let needed = term.source == TermSource::Proxy || waits;
            images.push(needed.then(|| unit.proxied(half, evaluate)).transpose()?);
        }
        Ok(images)
    }
}

/// Lights of some terms, chosen by number and term.
fn lights(terms: &[LightTerm], is_needed: impl Fn(usize, &LightTerm) -> bool) -> Vec<Light> {
    let needed = terms.iter().enumerate().filter(|(number, term)| is_needed(*number, term));
    needed.map(|(_, term)| term.light.clone()).collect()
}

/// True if another picture than the one that was begun is asked for.
fn is_outdated(state: &State, rendered: (u64, u64)) -> bool {
    state.closed || state.requests != rendered.0
}

/// True if something was not rendered yet.
fn has_news(state: &State, rendered: (u64, u64)) -> bool {
    let something = state.dump.is_some() || state.base.is_some();
    state.closed || something && state.request.is_some() && (state.requests, state.deliveries) != rendered
}
