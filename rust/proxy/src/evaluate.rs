use rayon::prelude::*;

use crate::encoded::EncodedTiles;
use crate::loss::TILE;
use crate::network::{Network, NetworkContext};
use crate::scene_cache::SceneCache;
use crate::simd::{AlignedVec, Isa, LANES};
use crate::{LightParams, MAX_PARAMS};

/// Tiles that one task runs.
const TASK_TILES: usize = 16;

/// A network with its weights, and all that is known of the pixels without a light.
pub(crate) struct Evaluator<N: Network> {
    network: N,
    packed: N::Packed,
    params: Vec<f32>,
    isa: Isa,
    pixel_count: usize,
    /// Row-major pixels; lanes past the last one repeat it.
    encoded: EncodedTiles,
}

impl<N: Network> Evaluator<N> {
    /// Packs the weights and encodes all pixels.
    pub fn new(network: N, params: Vec<f32>, scene: &SceneCache, pixel_count: usize, isa: Isa) -> Self {
        let packed = network.pack(&params);
        let context = NetworkContext { isa, scene, params: &params };
        let exact = network.exact_rows();
        let rows = [network.pixel_rows() - exact, exact];
        let encoded = EncodedTiles::new(pixel_count.div_ceil(LANES), rows, |tile, out| {
            network.encode_pixels(context, &packed, &tile_pixels(tile, pixel_count), out);
        });
        Self { network, packed, params, isa, pixel_count, encoded }
    }

    /// The weights.
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// The network.
    pub fn network(&self) -> &N {
        &self.network
    }

    /// All pixels as [`Network::encode_pixels`] leaves them.
    pub fn encoded(&self) -> &EncodedTiles {
        &self.encoded
    }

    /// Part of the evaluation that depends on a light alone.
    pub fn light(&self, light: &LightParams) -> N::Lit {
        self.network.light(self.isa, &self.params, &self.packed, light)
    }

    /// The gradient by a light's parameters from a sum over pixels, as [`Network::light_backward`] makes it.
    pub fn finish_light_gradient(&self, lit: &N::Lit, sum: &[f32]) -> [f32; MAX_PARAMS] {
        self.network.finish_light_gradient(self.isa, &self.packed, lit, sum)
    }

    /// Values of a tile.
    fn tile_len(&self) -> usize {
        self.network.pixel_rows() * LANES
    }

    /// All pixels, `scale * max(output, 0)`.
    pub fn forward(&self, light: &LightParams, scale: f32, out: &mut [[f32; 3]]) {
        let lit = self.network.light(self.isa, &self.params, &self.packed, light);
        out.par_chunks_mut(TASK_TILES * LANES).enumerate().for_each_init(
            || (self.network.light_scratch(), AlignedVec::zeros(self.tile_len())),
            |(scratch, encoded), (task, out)| {
                for (tile, out) in out.chunks_mut(LANES).enumerate() {
                    self.encoded.expand(task * TASK_TILES + tile, encoded);
                    let mut y = [0.0; TILE];
                    self.network.infer(self.isa, &self.packed, &lit, scratch, encoded, &mut y);
                    write_pixels(&y, scale, out);
                }
            },
        );
    }

    /// Some pixels, `scale * max(output, 0)`.
    pub fn forward_pixels(&self, pixels: &[u32], light: &LightParams, scale: f32, out: &mut [[f32; 3]]) {
        let lit = self.network.light(self.isa, &self.params, &self.packed, light);
        let task = TASK_TILES * LANES;
        out.par_chunks_mut(task).zip(pixels.par_chunks(task)).for_each_init(
            || (self.network.light_scratch(), AlignedVec::zeros(self.tile_len())),
            |(scratch, encoded), (out, pixels)| {
                for (out, pixels) in out.chunks_mut(LANES).zip(pixels.chunks(LANES)) {
                    self.encoded.collect(pixels, encoded);
                    let mut y = [0.0; TILE];
                    self.network.infer(self.isa, &self.packed, &lit, scratch, encoded, &mut y);
                    write_pixels(&y, scale, out);
                }
            },
        );
    }

    /// Gradient by the light's parameters of a loss whose gradient by the pixel values `scale * max(output, 0)` is
    /// `d_pixels`. Where the output is below zero the clamp is passed over, so that an optimiser finds its way out.
    pub fn backward(
        &self,
        pixels: &[u32],
        light: &LightParams,
        (scale, d_scale): (f32, [f32; MAX_PARAMS]),
        d_pixels: &[[f32; 3]],
    ) -> [f32; MAX_PARAMS] {
        let lit = self.network.light(self.isa, &self.params, &self.packed, light);
        let len = self.network.light_gradient_len();
        let task = TASK_TILES * LANES;
        let partial: Vec<(Vec<f32>, f32)> = pixels
            .par_chunks(task)
            .zip(d_pixels.par_chunks(task))
            .map_init(
                || (self.network.light_scratch(), AlignedVec::zeros(self.tile_len())),
                |(scratch, encoded), (pixels, d_pixels)| {
                    let (mut sums, mut by_scale) = (vec![0.0; len], 0.0);
                    for (pixels, d_pixels) in pixels.chunks(LANES).zip(d_pixels.chunks(LANES)) {
                        self.encoded.collect(pixels, encoded);
                        let mut d_of = |y: &[f32], d: &mut [f32]| {
                            for (lane, d_pixel) in d_pixels.iter().enumerate() {
                                for (channel, d_value) in d_pixel.iter().enumerate() {
                                    let at = channel * LANES + lane;
                                    d[at] = scale * d_value;
                                    by_scale += y[at].max(0.0) * d_value;
                                }
                            }
                        };
                        self.network.light_backward(
                            self.isa,
                            &self.packed,
                            &lit,
                            scratch,
                            encoded,
                            &mut d_of,
                            &mut sums,
                        );
                    }
                    (sums, by_scale)
                },
            )
            .collect();
        let (mut sums, mut by_scale) = (vec![0.0; len], 0.0);
        for (part, part_by_scale) in partial {
            by_scale += part_by_scale;
            for (sum, part) in sums.iter_mut().zip(part) {
                *sum += part;
            }
        }
        let gradient = self.network.finish_light_gradient(self.isa, &self.packed, &lit, &sums);
        std::array::from_fn(|i| gradient[i] + by_scale * d_scale[i])
    }

    /// Pixels of the whole image.
    pub fn pixel_count(&self) -> usize {
        self.pixel_count
    }
}

fn tile_pixels(tile: usize, pixel_count: usize) -> [u32; LANES] {
    std::array::from_fn(|lane| (tile * LANES + lane).min(pixel_count - 1) as u32)
}

fn write_pixels(y: &[f32; TILE], scale: f32, out: &mut [[f32; 3]]) {
    for (lane, pixel) in out.iter_mut().enumerate() {
        *pixel = std::array::from_fn(|channel| scale * y[channel * LANES + lane].max(0.0));
    }
}
