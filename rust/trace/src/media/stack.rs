/// Most media that overlap, as in Cycles; further ones are left out.
pub(super) const DEEPEST: usize = 32;

/// Media around a point, by their numbers; the outermost comes first. Each counts once, however often its hull was entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct VolumeStack {
    entries: [u32; DEEPEST],
    count: usize,
}

impl VolumeStack {
    /// Space with no medium, or the world's.
    pub fn new(world: Option<u32>) -> Self {
        let mut stack = Self { entries: [0; DEEPEST], count: 0 };
        if let Some(medium) = world {
            stack.enter(medium);
        }
        stack
    }

    /// The stack of some media, the outermost first.
    pub fn of(media: &[u32]) -> Self {
        let mut stack = Self::default();
        media.iter().for_each(|medium| stack.enter(*medium));
        stack
    }

    /// Numbers of the media.
    pub fn media(&self) -> &[u32] {
        &self.entries[..self.count]
    }

    /// Goes into a medium.
    pub fn enter(&mut self, medium: u32) {
        if self.count < DEEPEST && !self.media().contains(&medium) {
            self.entries[self.count] = medium;
            self.count += 1;
        }
    }

    /// Goes out of a medium.
    pub fn leave(&mut self, medium: u32) {
        if let Some(place) = self.media().iter().position(|entry| *entry == medium) {
            self.entries.copy_within(place + 1..self.count, place);
            self.count -= 1;
        }
    }
}

impl Default for VolumeStack {
    fn default() -> Self {
        Self::new(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_medium_counts_once_and_is_left_at_once() {
        let mut stack = VolumeStack::new(Some(7));
        for medium in [3, 5, 3] {
            stack.enter(medium);
        }
        assert_eq!(stack.media(), [7, 3, 5]);
        stack.leave(3);
        assert_eq!(stack.media(), [7, 5]);
        stack.leave(3);
        assert_eq!(stack.media(), [7, 5]);
    }

    #[test]
    fn media_beyond_the_most_are_left_out() {
        let mut stack = VolumeStack::default();
        (0..40).for_each(|medium| stack.enter(medium));
        assert_eq!(stack.media().len(), 32);
        stack.leave(39);
        assert_eq!(stack.media().len(), 32);
    }
}
