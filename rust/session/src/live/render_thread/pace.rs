//! Quality of the next picture of a drag, by how long those before it took.

use std::time::Duration;

/// Time for which lights that moved are connected before a picture of a drag is shown, and for which more paths are added.
const BUDGET: Duration = Duration::from_millis(60);
/// Pictures are of half the size after one that was slow to put together, and of the full size again after a quick one.
const SLOW: Duration = Duration::from_millis(50);
const QUICK: Duration = Duration::from_millis(12);

/// Quality of the next picture of a drag: the best that the machine makes in time. It starts at the best.
///
/// Lights that moved are connected at one pixel of each block, whose side doubles when that was late, and halves when four
/// times as many pixels are in time as well. Where the coarsest blocks are late, proxies stand in.
#[derive(Clone, Copy, Debug)]
pub(in crate::live) struct DragPace {
    budget: Duration,
    /// Side of the blocks.
    block: usize,
    /// True once the coarsest blocks were late.
    is_lost: bool,
    /// 1, or 2 for pictures of half the size.
    scale: usize,
}

impl Default for DragPace {
    fn default() -> Self {
        Self::new(BUDGET)
    }
}

impl DragPace {
    pub fn new(budget: Duration) -> Self {
        Self { budget, block: 1, is_lost: false, scale: 1 }
    }

    /// Side of the blocks in which lights are connected, of at most `coarsest` pixels.
    pub fn block(&self, coarsest: usize) -> usize {
        self.block.min(coarsest)
    }

    /// True if lights that a proxy knows are connected at all.
    pub fn connects(&self) -> bool {
        !self.is_lost
    }

    /// Scale of the picture: 1, or 2 for half the size.
    pub fn scale(&self) -> usize {
        self.scale
    }

    /// True if connecting or adding paths for so long is too long.
    pub fn is_late(&self, took: Duration) -> bool {
        took >= self.budget
    }

    /// Takes in how long it took to connect the lights that moved in blocks of this side, or how long until that was given up.
    pub fn connected(&mut self, took: Duration, block: usize, coarsest: usize) {
        if self.is_late(took) {
            self.is_lost = block >= coarsest;
            self.block = coarsest.min(2 * block);
        } else if !self.is_late(4 * took) {
            self.block = (block / 2).max(1);
        }
    }

    /// Takes in how long it took to put a picture together.
    pub fn shown(&mut self, took: Duration) {
        if took > SLOW {
            self.scale = 2;
        } else if took < QUICK {
            self.scale = 1;
        }
    }

    /// Lets the next drag try the coarsest blocks once more.
    pub fn rest(&mut self) {
        self.is_lost = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Blocks of the pictures of a drag whose lights take so long at the full size, and whether proxies stand in at last.
    fn blocks(pace: &mut DragPace, whole: Duration, pictures: usize) -> (Vec<usize>, bool) {
        let mut blocks = Vec::new();
        while blocks.len() < pictures && pace.connects() {
            let block = pace.block(4);
            let took = whole / (block * block) as u32;
            pace.connected(took.min(60 * MS), block, 4);
            if !pace.is_late(took) {
                blocks.push(block);
            }
        }
        (blocks, !pace.connects())
    }

    #[test]
    fn blocks_are_the_finest_that_are_in_time() {
        for (whole, block) in [(59, 1), (60, 2), (239, 2), (240, 4), (959, 4)] {
            let found = blocks(&mut DragPace::default(), whole * MS, 3);
            assert_eq!(found, (vec![block; 3], false), "{whole} ms");
        }
        assert_eq!(blocks(&mut DragPace::default(), 960 * MS, 3), (Vec::new(), true));
    }

    #[test]
    fn blocks_are_remembered_and_become_finer_once_that_is_in_time() {
        let mut pace = DragPace::default();
        assert_eq!(blocks(&mut pace, 300 * MS, 2).0, [4, 4]);
        pace.rest();
        assert_eq!(blocks(&mut pace, 300 * MS, 2).0, [4, 4], "the next drag");
        assert_eq!(blocks(&mut pace, 20 * MS, 4).0, [4, 2, 1, 1], "fewer lights");
    }

    #[test]
    fn proxies_stand_in_until_a_drag_is_over() {
        let mut pace = DragPace::default();
        assert!(blocks(&mut pace, 2000 * MS, 1).1);
        pace.rest();
        assert_eq!(blocks(&mut pace, 500 * MS, 1), (vec![4], false));
    }

    #[test]
    fn small_pictures_have_no_blocks() {
        let mut pace = DragPace::new(Duration::ZERO);
        pace.connected(Duration::ZERO, 1, 1);
        assert!(!pace.connects() && pace.block(1) == 1);
    }

    #[test]
    fn pictures_are_of_half_the_size_from_a_slow_one_to_a_quick_one() {
        let mut pace = DragPace::default();
        let scales = [20, 60, 20, 11, 20].map(|ms| {
            pace.shown(ms * MS);
            pace.scale()
        });
        assert_eq!(scales, [1, 2, 2, 1, 1]);
    }
}
