//! The smoothed gather as the optimiser sees it.

use relume_dump::{Aovs, Manifest};
use relume_gather::{DenoiseQuality, Gather, GatherError, PreparedLight, SampleSplit, SoftGather, relight};
use relume_image::Image;
use relume_optimise::{Compare, Goal, Linear, LossGradient, PictureCells, Relight, RelightError, TermTarget};
use relume_scene::{LANES, Light};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::scene_view::UnitPictures;
use super::step_targets::step_targets;
use crate::device::blocks::BlockVertices;
use crate::device::connections::Connections;
use crate::device::gather::DeviceGather;
use crate::device::layers::DeviceLayers;
use crate::error::SessionError;
use crate::progress::{Monitor, Stage};
use crate::relight::denoise::Denoise;
use crate::relight::light_cache::{LightCache, key};
use crate::relight::relighter::Relighter;
use crate::relight::statics::StaticLayer;

/// Most pixels along the edge of the cells whose means are compared. The noise of a gathered picture is an eighth
/// there. A tonemapped mean is less biased by it than the mean of tonemapped pixels.
const LARGEST_CELL: usize = 8;
/// Cells that a small picture should at least have.
const LEAST_CELLS: usize = 512;
/// Least cells in the place of any goal: those at its edge are partly beside it.
const LEAST_CELLS_OF_PLACE: f32 = 64.0;

/// Parts of a dump that solving needs besides the whole.
pub(super) struct SolveDump {
    /// The first passes: much softened lights are crossed by so many paths that few of them are enough.
    few: [(f32, DeviceGather); 2],
    denoise: Denoise,
    connected: Option<ConnectedBlocks>,
    /// Pixels along the edge of the squares that are averaged to one.
    shrink: usize,
    /// Width and height of the averaged picture.
    size: (usize, usize),
    cell: usize,
}

/// Vertices that lights are connected to, where the scene is at hand: of each pixel of the averaged picture, and of each cell.
struct ConnectedBlocks {
    pixels: BlockVertices,
    cells: BlockVertices,
}

/// Most paths of the vertices for pictures; but two of each pixel are there.
const PATHS_OF_PICTURE: usize = 1 << 19;
/// Square root of the paths of the vertices of each cell, for either half.
const SIDE_OF_CELL: usize = 4;

impl ConnectedBlocks {
    fn new(connections: &Arc<Connections>, shrink: usize, cell: usize, monitor: &Monitor) -> Option<Self> {
        let Manifest { width, height, .. } = connections.manifest();
        let pixels = width.div_ceil(shrink) * height.div_ceil(shrink);
        let fits = |side: &usize| 2 * side * side * pixels <= PATHS_OF_PICTURE;
        let side = [4, 2].into_iter().find(fits).unwrap_or(1);
        let stop = || monitor.cancelled();
        let pixels = BlockVertices::new(connections, shrink, side, &stop)?;
        Some(Self { pixels, cells: BlockVertices::new(connections, cell, SIDE_OF_CELL, &stop)? })
    }
}

/// Softness from which so many paths per pixel are enough.
const ENOUGH: [(f32, u32); 2] = [(0.05, 6), (0.015, 24)];
/// Bytes of unit images that are kept.
const MOST_KEPT: usize = 1 << 28;
/// Bytes of full pictures that are held at a time: lights near each other cost less together.
const MOST_AT_ONCE: usize = 1 << 27;
/// Pixels that are denoised in a moment, which are more than the cells of a comparison. Pictures are shrunk to this,
/// but not below their cells.
const QUICKLY_DENOISED: usize = 40_000;

impl SolveDump {
    /// Prepares for goals of full size. None without a dump. Without a denoiser the user is warned, and pictures stay
    /// noisy.
    pub fn new(relighter: &Relighter, goals: &[Goal], monitor: &Monitor) -> Option<Self> {
        let gather = relighter.gather()?;
        let aovs = relighter.aovs();
        let (width, height) = (aovs.albedo.width, aovs.albedo.height);
        let cell = edge_of_cells(width * height, goals);
        let is_quick = |shrink: &usize| width * height / (shrink * shrink) <= QUICKLY_DENOISED;
        let shrinks = [1, 2, 4, 8].into_iter().filter(|shrink| cell.is_multiple_of(*shrink));
        let shrink = shrinks.clone().find(is_quick).or(shrinks.max()).unwrap_or(1);
        let (albedo, normal) = (aovs.albedo.shrunk(shrink), aovs.normal.shrunk(shrink));
        let size = (albedo.width, albedo.height);
        let features = Aovs { albedo, normal, ..aovs.clone() };
        let few =
            ENOUGH.map(|(softness, samples)| (softness, DeviceGather::new(first_passes(gather, samples))));
        let denoise = Denoise::new(&features, relighter.compute().gpu.as_deref());
        denoise.missing().iter().for_each(|reason| monitor.warn(reason));
        let connections = relighter.device_gather()?.connections();
        let connected =
            connections.and_then(|connections| ConnectedBlocks::new(connections, shrink, cell, monitor));
        Some(Self { few, denoise, connected, shrink, size, cell: cell / shrink })
    }

    /// Factor by which pictures are smaller along each edge.
    pub fn shrink(&self) -> usize {
        self.shrink
    }

    /// Static light and world, without noise.
    pub fn statics(&self, relighter: &Relighter) -> Result<[Image; 2], SessionError> {
        let aovs = relighter.aovs();
        let statics = |image: &Image| StaticLayer::new(image.shrunk(self.shrink)).final_image(&self.denoise);
        Ok([statics(&aovs.emission)?, statics(&aovs.world)?])
    }

    /// Lights for radiance 1, without noise and exact.
    pub fn units(
        &self,
        relighter: &Relighter,
        lights: &[Light],
        monitor: &Monitor,
    ) -> Result<Vec<UnitPictures>, SessionError> {
        let lights: Vec<Light> = lights.iter().map(key).collect();
        let mut units = Vec::with_capacity(lights.len());
        let stage = monitor.stage(Stage::Gather, 0, lights.len() as u64);
        for some in lights.chunks(at_once(relighter)) {
            if monitor.cancelled() {
                return Err(SessionError::Cancelled);
            }
            let [mut gathered] = self.crossed(relighter, some, [SampleSplit::All], monitor)?;
            for (light, halves) in self.connected(some)? {
                halves.iter().for_each(|half| gathered[light].add_scaled(half, &[0.5; 3]));
            }
            units.append(&mut gathered);
            stage.advance(some.len() as u64, "");
        }
        let exact: Vec<Arc<Image>> = units.iter().cloned().map(Arc::new).collect();
        self.denoise.images(&mut units, DenoiseQuality::High)?;
        Ok(units
            .into_iter()
            .zip(exact)
            .map(|(clean, exact)| UnitPictures { clean: Arc::new(clean), exact })
            .collect())
    }

    /// Pictures of lights for radiance 1 by the crossings of each of some shares of the paths, without what is connected.
    fn crossed<const SHARES: usize>(
        &self,
        relighter: &Relighter,
        lights: &[Light],
        shares: [SampleSplit; SHARES],
        monitor: &Monitor,
    ) -> Result<[Vec<Image>; SHARES], SessionError> {
        let Some(gather) = relighter.device_gather() else { return Ok([const { Vec::new() }; SHARES]) };
        let blocks = self.connected.as_ref().map(|connected| &connected.pixels);
        let prepared = prepared(gather.gather(), blocks, lights)?;
        let mut pictures = [const { Vec::new() }; SHARES];
        for (share, pictures) in shares.into_iter().zip(&mut pictures) {
            let images = gather.crossed_images(&prepared, share, relighter.compute(), monitor)?;
            pictures.extend(images.iter().map(|image| image.shrunk(self.shrink)));
        }
        Ok(pictures)
    }

    /// Connected parts of lights for radiance 1, by their number: two pictures of other paths each.
    fn connected(&self, lights: &[Light]) -> Result<Vec<(usize, [Image; 2])>, SessionError> {
        let Some(ConnectedBlocks { pixels, .. }) = &self.connected else { return Ok(Vec::new()) };
        let (width, height) = self.size;
        let image = |data: Vec<[f32; 3]>| Image { width, height, channels: 3, data: data.into_flattened() };
        let all: Vec<u32> = (0..(width * height) as u32).collect();
        let halves = pixels.halves(lights, &all)?;
        Ok(halves.into_iter().map(|(light, halves)| (light, halves.map(image))).collect())
    }

    /// Means of cells of a noisy picture, denoised first. At the best quality a polish would take up to twice as long,
    /// for lights that are about as good (`docs/solve.md`).
    fn clean_cells(&self, noisy: Image) -> Result<Vec<[f32; 3]>, SessionError> {
        let mut images = [noisy];
        self.denoise.images(&mut images, DenoiseQuality::Balanced)?;
        Ok(self.cells(&images[0]))
    }

    /// The means of cells.
    fn cells(&self, image: &Image) -> Vec<[f32; 3]> {
        image.shrunk(self.cell).data.as_chunks::<3>().0.to_vec()
    }
}

/// Lights made ready for a gather, without what is connected to vertices.
fn prepared(
    gather: &Gather,
    vertices: Option<&BlockVertices>,
    lights: &[Light],
) -> Result<Vec<PreparedLight>, GatherError> {
    vertices.map_or_else(|| gather.prepare_all(lights), |vertices| vertices.crossed(gather, lights))
}

/// Pixels along the edge of the cells of a picture of so many.
fn edge_of_cells(pixels: usize, goals: &[Goal]) -> usize {
    let place = |goal: &Goal| Some(goal.pixels.as_ref()?.iter().sum::<f32>() / LEAST_CELLS_OF_PLACE);
    let largest = goals.iter().filter_map(place).fold((pixels / LEAST_CELLS) as f32, f32::min);
    (largest.sqrt() as usize).clamp(1, LARGEST_CELL)
}

/// Lights whose whole pictures are held at a time.
fn at_once(relighter: &Relighter) -> usize {
    (MOST_AT_ONCE / (relighter.aovs().albedo.pixel_count() * 3 * size_of::<f32>())).max(1)
}

/// First passes with so many samples.
fn first_passes(gather: &Gather, samples: u32) -> Gather {
    let dump = gather.dump();
    let of =
        |passes: &usize| dump.manifest().passes.iter().take(*passes).map(|pass| pass.samples).sum::<u32>();
    let passes = (1..=dump.complete_passes()).find(|passes| of(passes) >= samples);
    Gather::new(passes.map_or_else(|| dump.clone(), |passes| dump.passes(0..passes)))
}

/// A dump.
pub(super) struct GatherRelight<'a> {
    relighter: &'a Relighter,
    monitor: &'a Monitor,
    soft: SoftDump<'a>,
    few: Vec<(f32, SoftDump<'a>)>,
    prepared: &'a SolveDump,
    /// Halves of the paths; all paths twice if there are too few for two pictures.
    halves: [SampleSplit; 2],
    units: Mutex<LightCache<HalfUnits>>,
}

/// Dump on its device, and smoothed.
struct SoftDump<'a>(&'a DeviceGather, SoftGather<'a>);

impl<'a> SoftDump<'a> {
    fn new(gather: &'a DeviceGather, cell: usize) -> Self {
        Self(gather, SoftGather::new(gather.gather(), cell))
    }
}

/// Unit images of a light by either half of the paths, of the size that is looked at.
type HalfUnits = Arc<[Image; 2]>;

impl<'a> GatherRelight<'a> {
    /// None without a dump.
    pub fn new(relighter: &'a Relighter, prepared: &'a SolveDump, monitor: &'a Monitor) -> Option<Self> {
        let (gather, cell) = (relighter.device_gather()?, prepared.cell * prepared.shrink);
        let few = prepared.few.iter().map(|(softness, few)| (*softness, SoftDump::new(few, cell))).collect();
        let (soft, units) = (SoftDump::new(gather, cell), Mutex::default());
        let halves = [SampleSplit::First, SampleSplit::Second];
        let has_both = halves.iter().all(|half| half.tile_samples(gather.gather().dump(), 0) > 0);
        let halves = if has_both { halves } else { [SampleSplit::All; 2] };
        Some(Self { relighter, monitor, soft, few, prepared, halves, units })
    }

    fn go_on(&self) -> Result<(), SessionError> {
        if self.monitor.cancelled() { Err(SessionError::Cancelled) } else { Ok(()) }
    }

    /// Unit images of some lights, cached or gathered.
    fn half_units(&self, lights: &[&Light]) -> Result<Vec<HalfUnits>, SessionError> {
        let known: Vec<Option<HalfUnits>> = {
            let kept = self.kept();
            lights.iter().map(|light| kept.get(light).cloned()).collect()
        };
        let is_new = |(light, known): (&&Light, &Option<HalfUnits>)| known.is_none().then(|| key(light));
        let new: Vec<Light> = lights.iter().zip(&known).filter_map(is_new).collect();
        let mut gathered = Vec::with_capacity(new.len());
        // Not under the lock: threads that wait for parts of a gather take up other lights meanwhile.
        for some in new.chunks(at_once(self.relighter)) {
            self.go_on()?;
            let [first, second] = self.prepared.crossed(self.relighter, some, self.halves, self.monitor)?;
            let mut halves: Vec<[Image; 2]> = first.into_iter().zip(second).map(<[Image; 2]>::from).collect();
            for (light, connected) in self.prepared.connected(some)? {
                halves[light]
                    .iter_mut()
                    .zip(&connected)
                    .for_each(|(half, of)| half.add_scaled(of, &[1.0; 3]));
            }
            gathered.extend(halves.into_iter().map(Arc::new));
        }
        let mut gathered = gathered.into_iter();
        Ok(known.into_iter().filter_map(|known| known.or_else(|| gathered.next())).collect())
    }

    /// [`Self::half_units`], which are cached: most lights stay when one is moved.
    fn kept_half_units(&self, lights: &[&Light]) -> Result<Vec<HalfUnits>, SessionError> {
        let units = self.half_units(lights)?;
        let mut kept = self.kept();
        for (light, units) in lights.iter().zip(&units) {
            kept.get_or_insert(light, || Arc::clone(units));
        }
        let needed: Vec<Light> = lights.iter().copied().cloned().collect();
        kept.trim(&needed, MOST_KEPT, |units| 2 * size_of_val(&units[0].data[..]));
        Ok(units)
    }

    /// Values of some lights by either half of the paths at some cells, outside of which the CPU sums nothing.
    fn exact_halves(
        &self,
        lights: &[&Light],
        cells: &[u32],
    ) -> Result<Vec<[Vec<[f32; 3]>; 2]>, SessionError> {
        let lights: Vec<Light> = lights.iter().map(|light| key(light)).collect();
        let SoftDump(gather, soft) = &self.soft;
        let vertices = self.prepared.connected.as_ref().map(|connected| &connected.cells);
        let mut values = Vec::with_capacity(lights.len());
        for some in lights.chunks(at_once(self.relighter)) {
            self.go_on()?;
            let crossed = prepared(gather.gather(), vertices, some)?;
            let [first, second] = self.halves.map(|half| self.crossed_cells(soft, &crossed, half, cells));
            let first_value = values.len();
            values.extend(first?.into_iter().zip(second?).map(<[Vec<[f32; 3]>; 2]>::from));
            let Some(vertices) = vertices else { continue };
            for (light, connected) in vertices.halves(some, cells)? {
                let sums = values[first_value + light].iter_mut().flatten();
                for (sum, value) in sums.zip(connected.iter().flatten()) {
                    sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
                }
            }
        }
        Ok(values)
    }

    /// Sums of lights over the crossings of some of the paths at some cells.
    fn crossed_cells(
        &self,
        soft: &SoftGather,
        crossed: &[PreparedLight],
        half: SampleSplit,
        cells: &[u32],
    ) -> Result<Vec<Vec<[f32; 3]>>, SessionError> {
        let compute = self.relighter.compute();
        if compute.gpu.is_none() {
            return Ok(soft.exact(crossed, half, cells)?);
        }
        let images = self.soft.0.crossed_images(crossed, half, compute, self.monitor)?;
        let at_cells = |image: &Image| {
            let whole = self.prepared.cells(&image.shrunk(self.prepared.shrink));
            cells.iter().map(|cell| whole[*cell as usize]).collect()
        };
        Ok(images.iter().map(at_cells).collect())
    }

    fn halves_of_cells(&self, units: &HalfUnits) -> [Vec<[f32; 3]>; 2] {
        units.each_ref().map(|unit| self.prepared.cells(unit))
    }

    fn kept(&self) -> MutexGuard<'_, LightCache<HalfUnits>> {
        self.units.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Dump that a light of this softness is gathered from: few paths while it is soft.
    fn soft(&self, softness: f32) -> &SoftDump<'a> {
        let few = self.few.iter().find(|(from, _)| softness >= *from);
        few.map_or(&self.soft, |(_, few)| few)
    }

    /// A smoothed light's values and derivatives.
    fn slopes(
        &self,
        light: &Light,
        softness: f32,
        cells: &[u32],
    ) -> Result<relume_gather::UnitValues, SessionError> {
        self.go_on()?;
        let SoftDump(gather, soft) = self.soft(softness);
        gather.linearise(soft, (light, softness), cells, self.relighter.compute(), self.monitor)
    }
}

impl Relight for GatherRelight<'_> {
    fn size(&self) -> (usize, usize) {
        self.prepared.size
    }

    fn cell(&self) -> usize {
        self.prepared.cell
    }

    fn values(&self, light: &Light, softness: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        if softness > 0.0 {
            return Ok(self.slopes(light, softness, cells)?.values);
        }
        let units = self.kept_half_units(&[light])?;
        let [a, b] = self.halves_of_cells(&units[0]);
        let mean = |cell: &u32| std::array::from_fn(|c| 0.5 * (a[*cell as usize][c] + b[*cell as usize][c]));
        Ok(cells.iter().map(mean).collect())
    }

    fn half_values(&self, lights: &[&Light], cells: &[u32]) -> Result<Vec<[Vec<[f32; 3]>; 2]>, RelightError> {
        Ok(self.exact_halves(lights, cells)?)
    }

    fn pull_back(
        &self,
        light: &Light,
        softness: f32,
        cells: &[u32],
        d_values: &[[f32; 3]],
    ) -> Result<[f32; LANES], RelightError> {
        let slopes = self.slopes(light, softness, cells)?.slopes;
        let mut sums = [0.0; LANES];
        for (d, slopes) in d_values.iter().zip(&slopes) {
            for (sum, slope) in sums.iter_mut().zip(slopes) {
                *sum += (0..3).map(|c| d[c] * slope[c]).sum::<f32>();
            }
        }
        Ok(sums)
    }

    /// Gathered from either half of the paths, which is then denoised.
    fn picture(&self, lights: &[&Light]) -> Result<PictureCells, RelightError> {
        let units = self.kept_half_units(lights)?;
        let half = |half: usize| {
            let pairs: Vec<_> =
                units.iter().zip(lights).map(|(unit, light)| (&unit[half], light.radiance)).collect();
            let size = units.first().map_or((0, 0), |unit| (unit[half].width, unit[half].height));
            relight(size, &pairs)
        };
        let (a, b) = (half(0), half(1));
        let exact = [&a, &b].map(|half| self.prepared.cells(half));
        Ok(PictureCells { exact, clean: [self.prepared.clean_cells(a)?, self.prepared.clean_cells(b)?] })
    }

    fn linearise(&self, light: &Light, softness: f32, cells: &[u32]) -> Result<Option<Linear>, RelightError> {
        let linear = self.slopes(light, softness, cells)?;
        Ok(Some(Linear { values: linear.values, slopes: linear.slopes }))
    }

    fn comparison<'b>(
        &'b self,
        base: &[[f32; 3]],
        still: &[&[[f32; 3]]],
    ) -> Result<Option<Box<dyn Compare + 'b>>, RelightError> {
        if self.relighter.compute().gpu.is_none() {
            return Ok(None);
        }
        Ok(Some(Box::new(GatherCompare { relight: self, layers: DeviceLayers::new(base, still) })))
    }
}

/// Smoothed lights' pictures compared on the GPU.
struct GatherCompare<'a> {
    relight: &'a GatherRelight<'a>,
    layers: DeviceLayers,
}

impl Compare for GatherCompare<'_> {
    fn gradient(
        &self,
        lights: &[&Light],
        still: &[[f32; 3]],
        softness: f32,
        targets: &[TermTarget],
    ) -> Result<Option<LossGradient>, RelightError> {
        // Exact pictures are denoised.
        if softness == 0.0 {
            return Ok(None);
        }
        self.relight.go_on()?;
        let GatherRelight { relighter, monitor, .. } = self.relight;
        let SoftDump(gather, soft) = self.relight.soft(softness);
        let goals = (&self.layers, still, &step_targets(targets));
        let compared = gather.compare(soft, (lights, softness), goals, relighter.compute(), monitor)?;
        Ok(compared.map(|of| LossGradient { loss: of.loss, lights: of.lights, still: of.layers }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_optimise::Criterion;

    #[test]
    fn small_places_have_small_cells() {
        let place =
            |pixels: usize| Goal { criterion: Criterion::Keep, pixels: Some(vec![1.0; pixels]), weight: 1.0 };
        let (small, large) = (160 * 90, 1920 * 1080);
        assert_eq!([small, large].map(|pixels| edge_of_cells(pixels, &[])), [5, 8]);
        assert_eq!([10_000, 400, 5].map(|pixels| edge_of_cells(large, &[place(pixels)])), [8, 2, 1]);
        assert_eq!(edge_of_cells(large, &[place(large), place(400)]), 2);
    }
}
