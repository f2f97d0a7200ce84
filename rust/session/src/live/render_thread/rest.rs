//! Work at rest, once a picture is there.

use super::super::board::Stage;
use super::super::shared::{LiveState, State};
use super::super::terms::{LightTerm, TermSource};
use super::super::view::{BakeView, shown_statics};
use super::{RenderThread, has_news};
use crate::bake::world::forget;
use crate::error::SessionError;

impl RenderThread {
    /// Stores the light of another world for when the bake is opened again, once no more paths are to be expected.
    pub(super) fn store_world(&mut self, view: &BakeView) {
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

    /// Denoises stale pictures one at a time; false if something newer came up.
    pub(super) fn refine(&mut self, view: &mut BakeView, terms: &[LightTerm]) -> Result<bool, SessionError> {
        let (denoise, quality) = (&view.denoise[0], view.quality);
        let stop = || has_news(&self.shared.lock(), self.rendered);
        for term in terms.iter().filter(|term| term.source == TermSource::Gather) {
            let gathered = &mut self.units.of(&term.light).gathered;
            if gathered.is_done(quality) {
                continue;
            }
            self.turn = None;
            self.turn = self.seat.turn(Stage::Refine, stop);
            if self.turn.is_none() || !gathered.denoise(denoise, quality, Some(&stop))? {
                return Ok(false);
            }
        }
        if let Some(world) = self.world.as_mut().filter(|world| !world.is_done(quality))
            && !world.gathered.denoise(denoise, quality, Some(&stop))?
        {
            return Ok(false);
        }
        for layer in &mut view.statics[shown_statics(self.world.is_some())] {
            if !layer.denoise(denoise, quality, Some(&stop))? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}
