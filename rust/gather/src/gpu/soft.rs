use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use relume_gpu::{Binding, Buffer};
use relume_scene::Light;

use super::arguments::SlopesArguments;
use super::kernels::{self, GROUP_SIZE, lanes};
use super::{GpuGather, GpuLight};
use crate::soft::OUTPUTS;
use crate::soft::light::{ConeSlope, Enlarged, SoftBall, SoftCone, SoftLight, SoftProfile};
use crate::{GatherError, PreparedLight, SampleSplit, SoftGather, UnitValues};

/// Room for rounding of what a light reaches, as a share of its size and of the largest coordinate.
const REACH_ROUNDING: f32 = 1e-5;

/// `Enlarged` of `shaders/gather/soft.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct GpuEnlarged {
    inverse: f32,
    share: f32,
    edge: f32,
    is_free: f32,
}

/// `ConeSlope` of `shaders/gather/soft.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct GpuConeSlope {
    middle: f32,
    share: f32,
    edge: f32,
}

/// `SoftLight` of `shaders/gather/soft.wgsl`, where the fields are described.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct GpuSoftLight {
    center: [f32; 3],
    kind: u32,
    direction: [f32; 3],
    width: f32,
    along_u: [f32; 3],
    radius: f32,
    along_v: [f32; 3],
    fade: f32,
    half: [GpuEnlarged; 2],
    inverse_middle: f32,
    share: f32,
    edge: f32,
    by_angle: GpuConeSlope,
    by_blend: GpuConeSlope,
    tan_half: f32,
    normalisation: f32,
    knee: f32,
    chord2_by_angle: f32,
    reach2: f32,
    unused: [u32; 2],
}

/// A light's value at a cell, then its derivatives by the lanes of its shape; RGB.
pub(super) type Outputs = [[f32; 3]; OUTPUTS];

impl From<&Enlarged> for GpuEnlarged {
    fn from(of: &Enlarged) -> Self {
        Self { inverse: of.inverse, share: of.share, edge: of.edge, is_free: f32::from(u8::from(of.is_free)) }
    }
}

impl From<&ConeSlope> for GpuConeSlope {
    fn from(of: &ConeSlope) -> Self {
        Self { middle: of.middle, share: of.share, edge: of.edge }
    }
}

impl GpuSoftLight {
    /// `kind` is that of the light as it is, `magnitude` the largest coordinate in the scene.
    fn new(light: &SoftLight, kind: u32, magnitude: f32) -> Self {
        let reach2 = light.reach.ball().map_or(0.0, |ball| {
            let slack = REACH_ROUNDING * (ball.radius + magnitude.max(ball.center.abs().max_element()));
            (ball.radius + slack).powi(2)
        });
        let shared = Self { kind, reach2, ..Self::default() };
        match &light.profile {
            SoftProfile::Sphere(ball) | SoftProfile::FacingDisk(ball) => shared.with_ball(ball),
            SoftProfile::Spot { ball, cone, .. } => shared.with_ball(ball).with_cone(cone),
            SoftProfile::Area(plane) => Self {
                center: plane.center.into(),
                direction: plane.normal.into(),
                width: plane.width,
                along_u: plane.along[0].into(),
                along_v: plane.along[1].into(),
                fade: plane.fade,
                half: plane.half.each_ref().map(GpuEnlarged::from),
                tan_half: plane.spread.map_or(0.0, |spread| spread.exact.tan_half),
                normalisation: plane.spread.map_or(0.0, |spread| spread.exact.normalisation),
                knee: plane.spread.map_or(0.0, |spread| spread.knee),
                ..shared
            },
            SoftProfile::Sun(sun) => Self {
                direction: sun.direction.into(),
                half: [GpuEnlarged::from(&sun.enlarged); 2],
                chord2_by_angle: sun.chord2_by_angle,
                center: Vec3::ZERO.into(),
                ..shared
            },
        }
    }

    fn with_ball(self, ball: &SoftBall) -> Self {
        let half = [GpuEnlarged::from(&ball.enlarged); 2];
        Self { center: ball.center.into(), width: ball.width, radius: ball.radius, half, ..self }
    }

    fn with_cone(self, cone: &SoftCone) -> Self {
        let (by_angle, by_blend) = (GpuConeSlope::from(&cone.by_angle), GpuConeSlope::from(&cone.by_blend));
        let SoftCone { inverse_middle, share, edge, .. } = *cone;
        Self { direction: cone.axis.into(), inverse_middle, share, edge, by_angle, by_blend, ..self }
    }
}

impl GpuGather {
    /// [`SoftGather::linearise`] on the device, for the dump that this was made of. If that does not stay there, the records of the
    /// pixels of these cells are copied.
    ///
    /// # Errors
    /// Those of [`SoftGather::linearise`]; if there is no room for records ([`GpuGather::gathers_pixels`]) or values,
    /// or the device was lost.
    pub fn linearise(
        &self,
        soft: &SoftGather<'_>,
        light: &Light,
        softness: f32,
        cells: &[u32],
    ) -> Result<UnitValues, GatherError> {
        let softened = soft.soften(light, softness, cells)?;
        let on_device = self.gpu.buffer_of("cells", cells)?;
        let values = self.slopes(soft, &[softened], (cells, on_device.whole()))?;
        Ok(UnitValues::new(&light.shape, &self.gpu.read(&values, 0..cells.len())?))
    }

    /// Values and derivatives of some lights at some cells, which are here and on the device: light by light, then cell by cell.
    /// Only submits.
    pub(super) fn slopes(
        &self,
        soft: &SoftGather<'_>,
        softened: &[SoftLight],
        (cells, on_device): (&[u32], Binding<'_>),
    ) -> Result<Buffer<Outputs>, GatherError> {
        let values = self.gpu.zeros::<Outputs>("values of cells", softened.len() * cells.len())?;
        let exact: Vec<PreparedLight> = softened.iter().map(|light| light.exact.clone()).collect();
        let lights = self.lights(&exact)?;
        let smoothed = |light: &SoftLight| {
            let kind = GpuLight::new(&light.exact, self.magnitude, 0).plain_kind();
            self.gpu.buffer_of("smoothed light", &[GpuSoftLight::new(light, kind, self.magnitude)])
        };
        let smoothed = softened.iter().map(smoothed).collect::<Result<Vec<_>, _>>()?;
        let manifest = self.dump.manifest();
        let places = || cells.iter().flat_map(|&cell| soft.places(cell as usize)).collect();
        self.each_chunk_of(places, SampleSplit::All, |records, table, numbers| {
            let mut commands = self.gpu.commands("smoothed gather");
            // A record a thread, where parts are long enough: those of the exact gather take eight.
            let pixel_lanes = lanes(8 * table.part_length).min(GROUP_SIZE);
            let kernel = kernels::slopes(&self.gpu, pixel_lanes)?;
            for (number, smoothed) in smoothed.iter().enumerate() {
                let mut bindings = vec![lights.lights.whole(), lights.receivers.whole()];
                bindings.extend(table.bindings_and_shards(records));
                bindings.extend([smoothed.whole(), numbers.whole(), on_device, values.whole()]);
                let (columns, edge) = (soft.cells().0, soft.edge);
                let arguments = SlopesArguments {
                    cells: cells.len() as u32,
                    columns: columns as u32,
                    edge: edge as u32,
                    width: manifest.width as u32,
                    height: manifest.height as u32,
                    light: number as u32,
                };
                commands.run(&kernel.bind(&bindings)?, cells.len() as u32, bytemuck::bytes_of(&arguments));
            }
            Ok(commands)
        })?;
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;
    use relume_gpu::{Gpu, GpuChoice, GpuError};
    use relume_scene::{LANES, LightShape};

    use super::*;
    use crate::Gather;
    use crate::tests::kernels::{random_dump_of, random_lights};
    use crate::tests::light;

    fn gpu() -> Arc<Gpu> {
        Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
    }

    /// Root mean squares over all cells and channels of the difference of one number, and of the number itself.
    fn apart(found: &[[f32; 3]], expected: &[[f32; 3]]) -> (f32, f32) {
        let pairs = found.as_flattened().iter().zip(expected.as_flattened());
        let (error, whole) = pairs.fold((0.0, 0.0), |(error, whole), (a, b)| {
            assert!(a.is_finite(), "{a} for {b}");
            (error + (a - b).powi(2), whole + b * b)
        });
        (error.sqrt(), whole.sqrt())
    }

    fn slopes_of(linear: &UnitValues, lane: usize) -> Vec<[f32; 3]> {
        linear.slopes.iter().map(|slopes| slopes[lane]).collect()
    }

    #[test]
    fn values_and_slopes_are_those_of_the_cpu_for_all_lights() {
        let gather = Gather::new(random_dump_of(10, &[1, 3, 20]));
        // Cells of three pixels lie across tiles; those of the last row and column are smaller.
        let soft = SoftGather::new(&gather, 3);
        let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
        let in_chunks = GpuGather::in_chunks(gpu(), &gather, 400).unwrap();
        let little = gpu();
        little.set_memory_budget(Some(80_000));
        let streamed = GpuGather::new(little, &gather).unwrap();
        assert!(!streamed.is_resident());
        let cells: Vec<u32> = (0..16).rev().chain([3, 3]).collect();
        // Distances of metres are rounded to 1e-6 m, 2e-5 of the narrowest soft edge, and slopes of both signs cancel. Of a sun's
        // narrowest edge, a thousandth of a radian, 2e-4 are what WGSL allows a division of directions (2.5 units in the last
        // place), which cards make use of.
        let (tolerance, divided) = (3e-4, if on_gpu.gpu.summary().software { 3e-4 } else { 3e-3 });
        let (mut most, mut sloped) = (0.0_f32, 0);
        for (index, light) in random_lights().iter().enumerate() {
            let tolerance = if matches!(light.shape, LightShape::Sun { .. }) { divided } else { tolerance };
            for softness in [0.01, 0.1, 0.7] {
                let expected = soft.linearise(light, softness, &cells).unwrap();
                for on_gpu in [&on_gpu, &in_chunks, &streamed] {
                    let found = on_gpu.linearise(&soft, light, softness, &cells).unwrap();
                    let (error, whole) = apart(&found.values, &expected.values);
                    most = most.max(error / whole / tolerance);
                    for lane in 0..LANES {
                        let (error, whole) = apart(&slopes_of(&found, lane), &slopes_of(&expected, lane));
                        assert!(whole == 0.0 || light.shape.has_lane(lane), "light {index}, lane {lane}");
                        sloped += usize::from(whole != 0.0);
                        most = most.max(if error > 0.0 { error / whole / tolerance } else { 0.0 });
                    }
                }
            }
        }
        assert!(most < 1.0 && sloped > 2700, "{most} of what is allowed apart at most, {sloped} slopes");
    }

    #[test]
    fn all_is_finite_where_a_light_sits_on_the_vertices() {
        let gather = Gather::new(random_dump_of(4, &[4]));
        let soft = SoftGather::new(&gather, 4);
        let on_gpu = GpuGather::new(gpu(), &gather).unwrap();
        let shards: Vec<_> = gather.dump().shards().collect();
        let origin = (0..40).filter_map(|record| shards[0].segment(record)).nth(9).unwrap().origin;
        for light in random_lights() {
            let mut step = [0.0; LANES];
            let to_origin = origin - light.shape.center().unwrap_or_default();
            step[..3].copy_from_slice(&to_origin.to_array());
            let light = Light { shape: light.shape.moved(&step), ..light };
            for softness in [1e-6, 1e-2, 1.0] {
                let linear = on_gpu.linearise(&soft, &light, softness, &[0]).unwrap();
                let all =
                    linear.values.as_flattened().iter().chain(linear.slopes.as_flattened().as_flattened());
                assert!(all.into_iter().all(|number| number.is_finite()), "{:?} at {softness}", light.shape);
            }
        }
    }

    #[test]
    fn what_cannot_be_done_is_refused() {
        let gather = Gather::new(random_dump_of(6, &[4]));
        let (soft, gpu) = (SoftGather::new(&gather, 4), gpu());
        let on_gpu = GpuGather::new(Arc::clone(&gpu), &gather).unwrap();
        let lamp = light(LightShape::Sphere { center: Vec3::ZERO, radius: 0.5 });
        assert!(matches!(on_gpu.linearise(&soft, &lamp, 0.0, &[0]), Err(GatherError::Softness(_))));
        assert!(matches!(on_gpu.linearise(&soft, &lamp, 0.1, &[4]), Err(GatherError::Cell { .. })));
        assert_eq!(on_gpu.linearise(&soft, &lamp, 0.1, &[]).unwrap(), UnitValues::default());
        gpu.set_memory_budget(Some(1000));
        let streamed = GpuGather::new(gpu, &gather).unwrap();
        let error = streamed.linearise(&soft, &lamp, 0.1, &[0]).unwrap_err();
        assert!(matches!(error, GatherError::Gpu(GpuError::OutOfMemory { .. })), "{error}");
        assert!(!streamed.gathers_pixels());
    }

    relume_gpu::part_of_mirrors!(GpuEnlarged as Struct, GpuConeSlope as Struct);

    #[test]
    fn the_smoothed_light_has_the_layout_of_its_wgsl_twin() {
        relume_gpu::assert_mirror!(GpuEnlarged as "gather/soft", "Enlarged", { inverse, share, edge, is_free });
        relume_gpu::assert_mirror!(GpuConeSlope as "gather/soft", "ConeSlope", { middle, share, edge });
        assert_eq!(relume_gpu::layout::constant("gather/soft", "OUTPUTS").unwrap(), OUTPUTS as u32);
        relume_gpu::assert_mirror!(GpuSoftLight as "gather/soft", "SoftLight", {
            center, kind, direction, width, along_u, radius, along_v, fade, half, inverse_middle, share, edge, by_angle,
            by_blend, tan_half, normalisation, knee, chord2_by_angle, reach2,
        });
    }
}
