//! Speed of the gather against what the machine can do, measured in the same process just before: one thread, best of
//! several, on a made-up room that does not fit into the caches.

pub mod on_gpu;
mod paper;
mod room;

use std::hint::black_box;
use std::time::Instant;

use rayon::prelude::*;
use relume_dump::{Dump, DumpError};
use relume_gather::{Gather, GatherScratch, Isa, SampleSplit, SoftGather};
use relume_scene::LightShape;

use crate::figure::{Figure, Limit};
use room::{POSITION_BYTES, TILE, light, neighbour, quad, room, sphere};

/// Repetitions, of which the best counts.
const REPEATS: usize = 7;

/// Measures gathers for 1 and many lights. `megabytes` is the size of the made-up positions; 256 is well beyond caches.
///
/// # Errors
/// If the made-up dump cannot be packed, which would be a fault of the room.
pub fn measure(megabytes: usize) -> Result<Vec<Figure>, DumpError> {
    let gather = Gather::new(room(megabytes)?);
    let (records, tiles) = (gather.dump().record_count() as f64, gather.dump().manifest().tile_count());
    let read = records / best_seconds(tiles, |tile| read_positions(gather.dump(), tile));
    let plain = read * POSITION_BYTES * 1e-9;
    let mut figures = vec![Figure::new("plain read of positions, 1 thread", plain, "GB/s")];
    type LightMaker = fn(usize) -> LightShape;
    let kinds = [("sphere", sphere as LightMaker), ("quad", quad), ("neighbouring sphere", neighbour)];
    for (kind, shape) in kinds {
        for count in [1, 16] {
            let lights: Vec<_> = (0..count).map(|index| light(shape(index))).collect();
            let Ok(lights) = gather.prepare_all(&lights) else { continue };
            let seconds =
                best_seconds(tiles, |tile| drop(black_box(gather.tile(tile, &lights, SampleSplit::All))));
            let name = format!("gather of {count} {kind} lights, 1 thread");
            // Many lights share one pass over the bytes.
            let limit = Limit::bytes(read * count as f64 * 1e-9);
            let rate = records * count as f64 / seconds * 1e-9;
            figures.push(Figure::new(name, rate, "G segments/s").within(&[limit]));
        }
    }
    figures.push(all_threads(&gather));
    figures.push(pixel_targets(&gather));
    figures.extend(smoothed(&gather));
    Ok(figures)
}

/// One light on all threads of the current pool, against a plain read by as many.
fn all_threads(gather: &Gather) -> Figure {
    let (records, tiles) = (gather.dump().record_count() as f64, gather.dump().manifest().tile_count());
    let lights = gather.prepare_all(&[light(sphere(0))]).unwrap_or_default();
    let rate = |work: &(dyn Fn(usize) + Sync)| {
        let seconds = best_seconds(1, |_| (0..tiles).into_par_iter().for_each(work));
        records / seconds * 1e-9
    };
    let name = format!("gather of 1 sphere light, {} threads", rayon::current_num_threads());
    let value = rate(&|tile| drop(black_box(gather.tile(tile, &lights, SampleSplit::All))));
    let limit = Limit::bytes(rate(&|tile| read_positions(gather.dump(), tile)));
    Figure::new(name, value, "G segments/s").within(&[limit])
}

/// Targets as a training asks for them: a few lights at single pixels.
fn pixel_targets(gather: &Gather) -> Figure {
    const LIGHTS: usize = 4;
    let lights: Vec<_> = (0..LIGHTS).map(|index| light(sphere(index))).collect();
    let lights = gather.prepare_all(&lights).unwrap_or_default();
    let (mut scratch, mut values) = (GatherScratch::default(), vec![[0.0; 3]; lights.len()]);
    let seconds = best_seconds(TILE, |y| {
        for x in 0..TILE {
            gather.pixel_into(x, y, &lights, SampleSplit::All, &mut scratch, &mut values);
            black_box(&values);
        }
    });
    let segments = gather.dump().pixel(0, 0).map(|(shard, pixel)| shard.pixel(pixel).len()).sum::<usize>();
    let name = format!("pixel targets, {LIGHTS} lights a pixel, {segments} segments a pixel, 1 thread");
    Figure::new(name, (TILE * TILE * lights.len()) as f64 / seconds, "targets/s")
}

/// Cells as a solver asks for them: one light with all derivatives, from barely to widely smoothed.
fn smoothed(gather: &Gather) -> Vec<Figure> {
    let soft = SoftGather::new(gather, TILE / 2);
    let cells = soft.cells().0 * soft.cells().1;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let mut figures = Vec::new();
    for (pool, (kind, shape)) in
        pool.iter().flat_map(|pool| [(pool, ("sphere", sphere(0))), (pool, ("quad", quad(0)))])
    {
        for softness in [0.01, 0.1] {
            let light = light(shape);
            let seconds = best_seconds(cells, |cell| {
                drop(black_box(pool.install(|| soft.linearise(&light, softness, &[cell as u32]))));
            });
            let name = format!("derivatives of 1 {kind} light at softness {softness}, 1 thread");
            let rate = gather.dump().record_count() as f64 / seconds * 1e-9;
            figures.push(Figure::new(name, rate, "G segments/s"));
        }
    }
    figures
}

/// Sum over the parts of the best time of each: short parts make it likely that nothing else ran on the core meanwhile. The
/// parts take turns, so that none finds its data in a cache.
fn best_seconds(parts: usize, mut work: impl FnMut(usize)) -> f64 {
    let mut best = vec![f64::INFINITY; parts];
    for _ in 0..REPEATS {
        for (part, best) in best.iter_mut().enumerate() {
            let start = Instant::now();
            work(part);
            *best = best.min(start.elapsed().as_secs_f64());
        }
    }
    best.into_iter().sum()
}

fn read_positions(dump: &Dump, tile: usize) {
    let mut sum = 0;
    for shard in dump.tile(tile) {
        for stream in [shard.position_xy(), shard.position_z_flags()] {
            sum ^= xor(stream);
        }
    }
    black_box(sum);
}

fn xor(words: &[u32]) -> u32 {
    match Isa::detect() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: AVX2 has been detected.
        Isa::Avx512 | Isa::Avx2 => unsafe { xor_avx2(words) },
        Isa::Portable => xor_lanes(words),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn xor_avx2(words: &[u32]) -> u32 {
    xor_lanes(words)
}

/// Wide enough that the loads, not the sums, are the limit.
#[inline(always)]
fn xor_lanes(words: &[u32]) -> u32 {
    let mut sums = [0; 64];
    for chunk in words.as_chunks::<64>().0 {
        for (sum, word) in sums.iter_mut().zip(chunk) {
            *sum ^= word;
        }
    }
    sums.into_iter().fold(0, |a, b| a ^ b)
}
