//! Images of lights that are connected, and how they grow level by level.

use relume_image::Image;

/// Part of a light's unit image that is summed by connections.
pub(crate) struct ConnectedImage {
    pub levels: usize,
    /// Side of the blocks of pixels that have one value.
    pub block: usize,
    /// Paths per pixel behind it.
    pub paths: u32,
    pub image: Image,
    /// Draw of its error; empty for a single level.
    pub error: Image,
}

impl ConnectedImage {
    /// Image of one level more, which is of so many paths.
    pub(super) fn grown(before: Option<&Self>, mut image: Image, samples: u32) -> Self {
        let Some(before) = before else {
            return Self { levels: 1, block: 1, paths: samples, image, error: Image::default() };
        };
        let paths = before.paths + samples;
        let share = samples as f32 / paths as f32;
        // As in `Gathered::add`.
        let scale = (share * (1.0 - share)).sqrt();
        let mut error = before.image.clone();
        for ((value, error), before) in image.data.iter_mut().zip(&mut error.data).zip(&before.image.data) {
            let difference = *value - before;
            *value = before + share * difference;
            *error = scale * difference;
        }
        Self { levels: before.levels + 1, block: 1, paths, image, error }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.image.data.as_slice()) + size_of_val(self.error.data.as_slice())
    }
}
