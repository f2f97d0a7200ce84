//! Pictures while something is dragged.

use std::time::Instant;

use relume_scene::Light;

use super::{RenderThread, lights};
use crate::device::gather::Haste;
use crate::error::SessionError;
use crate::live::LiveRequest;
use crate::live::layers::FrameQuality;
use crate::live::terms::{LightTerm, TermSource};
use crate::live::view::BakeView;

impl RenderThread {
    /// Renders one picture of a drag, as good as time allows.
    pub(super) fn render_drag(
        &mut self,
        request: &LiveRequest,
        view: &BakeView,
        terms: &[LightTerm],
    ) -> Result<(), SessionError> {
        // A picture beside the one that is looked at holds that up as little as may be.
        let is_aside = !self.seat.is_attended();
        let own_scale = if is_aside { 2 } else { self.pace.scale() };
        let scale = request.half.map_or(own_scale, |half| if half { 2 } else { 1 });
        let scale = if view.can_be_halved() { scale } else { 1 };
        let block = self.block(view, scale);
        self.connect_in_time(request, view, terms, scale)?;
        let is_coarse = block.max(self.block(view, scale)) > 1 && view.connections.is_some();
        self.gather_in_time(request, view, terms, scale, !is_coarse && !is_aside)?;
        let start = Instant::now();
        self.show(request, view, terms, FrameQuality { scale, is_drag: true })?;
        self.pace.shown(start.elapsed());
        Ok(())
    }

    /// Connects moved lights that proxies know, as that is nearer to the truth, as finely as it is in time.
    fn connect_in_time(
        &mut self,
        request: &LiveRequest,
        view: &BakeView,
        terms: &[LightTerm],
        scale: usize,
    ) -> Result<(), SessionError> {
        let Some(pass) = view.passes.first() else { return Ok(()) };
        let moved =
            lights(terms, |_, term| self.is_waiting(request, view, term, true) && pass.connects(&term.light));
        while self.pace.connects() && !self.units.all_begun(&moved) {
            match self.begin(&moved, view, scale, true) {
                Ok(_) | Err(SessionError::Cancelled) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Sums other lights that moved, and what proxies lack. With `may_grow`, more paths are added while there is time.
    fn gather_in_time(
        &mut self,
        request: &LiveRequest,
        view: &BakeView,
        terms: &[LightTerm],
        scale: usize,
        may_grow: bool,
    ) -> Result<(), SessionError> {
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
        let start = Instant::now();
        let mut has_more = self.begin(&new, view, scale, false)?;
        while has_more && may_grow && !self.pace.is_late(start.elapsed()) {
            has_more = self.advance(&new, view, Haste::NONE)?;
        }
        Ok(())
    }

    /// Sums the first pass of some lights, of which some are connected; only for a while if `may_stop`. False if there is
    /// nothing to sum.
    ///
    /// # Errors
    /// [`SessionError::Cancelled`] if that was too long.
    fn begin(
        &mut self,
        moved: &[Light],
        view: &BakeView,
        scale: usize,
        may_stop: bool,
    ) -> Result<bool, SessionError> {
        let (start, pace) = (Instant::now(), self.pace);
        let is_late = || may_stop && pace.is_late(start.elapsed());
        let block = self.block(view, scale);
        let haste = if block == 1 { Haste::Until(&is_late) } else { Haste::Drag(block, &is_late) };
        let is_new = |light: &&Light| self.units.passes(light) == 0;
        let pass = view.passes.first();
        let connects = moved.iter().filter(is_new).any(|light| pass.is_some_and(|pass| pass.connects(light)));
        let mut step = self.advance(moved, view, haste);
        while matches!(step, Ok(true)) && !self.units.all_begun(moved) {
            step = self.advance(moved, view, haste);
        }
        if connects {
            self.pace.connected(start.elapsed(), block, view.coarsest_block());
        }
        step
    }

    /// Side of the blocks in which lights are connected for a picture of a scale.
    fn block(&self, view: &BakeView, scale: usize) -> usize {
        self.pace.block(view.coarsest_block()).max(scale)
    }
}
