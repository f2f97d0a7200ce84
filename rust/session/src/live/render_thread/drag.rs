//! Pictures while something is dragged.

use std::time::{Duration, Instant};

use super::{RenderThread, lights};
use crate::device::gather::Haste;
use crate::error::SessionError;
use crate::live::LiveRequest;
use crate::live::layers::FrameQuality;
use crate::live::terms::{LightTerm, TermSource};
use crate::live::view::BakeView;

/// Time for which a dragged light is gathered before it is shown.
const DRAG_BUDGET: Duration = Duration::from_millis(60);
/// Pictures of a drag that take longer are made at half the size, and shorter ones at full size again.
const SLOW: Duration = Duration::from_millis(50);
const QUICK: Duration = Duration::from_millis(12);

impl RenderThread {
    /// Renders one picture of a drag, as good as time allows.
    pub(super) fn render_drag(
        &mut self,
        request: &LiveRequest,
        view: &BakeView,
        terms: &[LightTerm],
    ) -> Result<(), SessionError> {
        let start = Instant::now();
        // A picture beside the one that is looked at holds that up as little as may be.
        let is_aside = !self.seat.is_attended();
        let own_scale = if is_aside { 2 } else { self.drag_scale };
        let scale = request.half.map_or(own_scale, |half| if half { 2 } else { 1 });
        let scale = if view.can_be_halved() { scale } else { 1 };
        // What is coarse is replaced by the next pass.
        let is_coarse = scale == 2 && view.passes.len() > 1;
        self.connect_in_time(request, view, terms, is_coarse, start)?;
        let is_needed = |number: usize, term: &LightTerm| match term.source {
            TermSource::FirstView => self.is_waiting(request, view, &terms[number + 1], true),
            TermSource::Gather => {
                let is_there = self.units.get(&term.light).is_some_and(|unit| unit.gathered.has_clean());
                !is_there && !self.is_waiting(request, view, term, true)
            }
            TermSource::DirectView => true,
            TermSource::Proxy => false,
        };
        let new = lights(terms, is_needed);
        let haste = if is_coarse { Haste::Drag(&|| false) } else { Haste::NONE };
        while self.advance(&new, view, haste)? {
            if self.units.all_begun(&new) && (is_aside || start.elapsed() > DRAG_BUDGET) {
                break;
            }
        }
        self.show(request, view, terms, FrameQuality { scale, is_drag: true })?;
        let took = start.elapsed();
        if took > SLOW {
            self.drag_scale = 2;
        } else if took < QUICK {
            self.drag_scale = 1;
        }
        Ok(())
    }

    /// Connects moved lights that proxies know, as their sums are nearer to the truth; not in this drag any more once the
    /// machine takes too long for that.
    fn connect_in_time(
        &mut self,
        request: &LiveRequest,
        view: &BakeView,
        terms: &[LightTerm],
        is_coarse: bool,
        start: Instant,
    ) -> Result<(), SessionError> {
        let Some(pass) = view.passes.first().filter(|_| self.connects_in_drag) else { return Ok(()) };
        let lights =
            lights(terms, |_, term| self.is_waiting(request, view, term, true) && pass.connects(&term.light));
        let is_late = move || start.elapsed() > DRAG_BUDGET;
        let haste = if is_coarse { Haste::Drag(&is_late) } else { Haste::Until(&is_late) };
        while !self.units.all_begun(&lights) {
            match self.advance(&lights, view, haste) {
                Ok(_) => {}
                Err(SessionError::Cancelled) => {
                    self.connects_in_drag = false;
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
