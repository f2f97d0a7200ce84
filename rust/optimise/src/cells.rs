use relume_image::Image;

/// A picture cut into squares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Cells {
    size: (usize, usize),
    edge: usize,
}

impl Cells {
    pub(crate) fn new(size: (usize, usize), edge: usize) -> Self {
        Self { size, edge }
    }

    pub(crate) fn count(&self) -> usize {
        self.size.0.div_ceil(self.edge) * self.size.1.div_ceil(self.edge)
    }

    /// Means of an RGB image.
    pub(crate) fn means(&self, image: &Image) -> Vec<[f32; 3]> {
        image.shrunk(self.edge).data.as_chunks::<3>().0.to_vec()
    }

    /// Means of one value a pixel.
    pub(crate) fn mean_weights(&self, weights: &[f32]) -> Vec<f32> {
        let mut sums = vec![(0.0, 0.0); self.count()];
        for (i, weight) in weights.iter().enumerate() {
            let (sum, count) = &mut sums[self.of_pixel(i)];
            *sum += weight;
            *count += 1.0;
        }
        sums.iter().map(|(sum, count)| sum / count).collect()
    }

    /// Least of one value a pixel.
    pub(crate) fn least_weights(&self, weights: &[f32]) -> Vec<f32> {
        let mut least = vec![f32::INFINITY; self.count()];
        for (i, weight) in weights.iter().enumerate() {
            let cell = &mut least[self.of_pixel(i)];
            *cell = cell.min(*weight);
        }
        least
    }

    fn of_pixel(&self, number: usize) -> usize {
        let (width, edge) = (self.size.0, self.edge);
        number / width / edge * width.div_ceil(edge) + number % width / edge
    }
}

/// Numbers of at most `count` of so many things, evenly spread.
pub(crate) fn spread(total: usize, count: usize) -> Vec<u32> {
    let count = count.min(total);
    (0..count).map(|i| (i * total / count) as u32).collect()
}
