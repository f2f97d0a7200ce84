//! Proxies as the optimiser sees them.

use glam::Vec3;
use relume_gpu::GpuError;
use relume_gpu::compare::Layers;
use relume_optimise::{Compare, LossGradient, Relight, RelightError, TermTarget};
use relume_proxy::{GpuProxy, LightKind, LightParams, Proxy, compare};
use relume_scene::{LANES, Light, lane};
use std::sync::Arc;

use super::step_targets::step_targets;
use crate::files::proxies::Proxies;

/// Proxies, each for its kind of light.
pub struct ProxyRelight<'a> {
    /// Trained proxies.
    pub proxies: &'a Proxies,
    /// Kinds of the moving lights, each with its proxy on the GPU if there is one.
    pub kinds: Vec<(LightKind, Option<&'a GpuProxy>)>,
    /// Width and height of the picture.
    pub size: (usize, usize),
}

impl<'a> ProxyRelight<'a> {
    fn params(light: &Light) -> Result<LightParams, RelightError> {
        LightParams::from_shape(&light.shape)
            .ok_or_else(|| format!("light '{}' has no proxy", light.name).into())
    }

    fn on_gpu(&self, kind: LightKind) -> Option<&'a GpuProxy> {
        self.kinds.iter().find(|(of, _)| *of == kind)?.1
    }

    fn on_cpu(&self, light: &Light, kind: LightKind) -> Result<&'a Proxy, RelightError> {
        let trained = self.proxies.of(kind).ok_or_else(|| format!("light '{}' has no proxy", light.name))?;
        Ok(&trained.proxy)
    }
}

impl Relight for ProxyRelight<'_> {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn values(&self, light: &Light, _: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        let params = Self::params(light)?;
        let mut values = vec![[0.0; 3]; cells.len()];
        match self.on_gpu(params.kind()) {
            Some(proxy) => proxy.forward_pixels(cells, &params, &mut values)?,
            None => self.on_cpu(light, params.kind())?.forward_pixels(cells, &params, &mut values)?,
        }
        Ok(values)
    }

    fn pull_back(
        &self,
        light: &Light,
        _: f32,
        cells: &[u32],
        d_values: &[[f32; 3]],
    ) -> Result<[f32; LANES], RelightError> {
        let params = Self::params(light)?;
        let gradient = match self.on_gpu(params.kind()) {
            Some(proxy) => proxy.backward(cells, &params, d_values)?,
            None => self.on_cpu(light, params.kind())?.backward(cells, &params, d_values)?,
        };
        Ok(by_lane(&params, &gradient))
    }

    fn comparison<'a>(
        &'a self,
        base: &[[f32; 3]],
        still: &[&[[f32; 3]]],
    ) -> Result<Option<Box<dyn Compare + 'a>>, RelightError> {
        let proxies: Option<Vec<&GpuProxy>> = self.kinds.iter().map(|(_, proxy)| *proxy).collect();
        let Some(proxies) = proxies.filter(|proxies| are_together(proxies)) else { return Ok(None) };
        let pictures: Vec<&[[f32; 3]]> = std::iter::once(&base).chain(still).copied().collect();
        match Layers::new(proxies[0].gpu(), &pictures) {
            Err(GpuError::OutOfMemory { .. } | GpuError::TooLarge { .. }) => Ok(None),
            layers => Ok(Some(Box::new(ProxyCompare { proxies, layers: layers? }))),
        }
    }
}

/// True if there are some, all on one device.
fn are_together(proxies: &[&GpuProxy]) -> bool {
    proxies.first().is_some_and(|first| proxies.iter().all(|proxy| Arc::ptr_eq(proxy.gpu(), first.gpu())))
}

/// Proxies' pictures compared on the GPU.
struct ProxyCompare<'a> {
    proxies: Vec<&'a GpuProxy>,
    layers: Layers,
}

impl Compare for ProxyCompare<'_> {
    fn gradient(
        &self,
        lights: &[&Light],
        still: &[[f32; 3]],
        _: f32,
        targets: &[TermTarget],
    ) -> Result<Option<LossGradient>, RelightError> {
        let params = |light: &&Light| Ok((ProxyRelight::params(light)?, light.radiance));
        let lights = lights.iter().map(params).collect::<Result<Vec<_>, RelightError>>()?;
        let compared = compare(&self.proxies, &self.layers, still, &lights, &step_targets(targets))?;
        let by_light = lights.iter().zip(compared.lights);
        let by_light = by_light.map(|((params, _), g)| (by_lane(params, &g.params), g.radiance));
        Ok(Some(LossGradient { loss: compared.loss, lights: by_light.collect(), still: compared.layers }))
    }
}

/// A gradient by the lanes of a shape from one by the parameters of its kind of light.
pub(super) fn by_lane(params: &LightParams, gradient: &[f32]) -> [f32; LANES] {
    let mut lanes = [0.0; LANES];
    lanes[lane::CENTER].copy_from_slice(&gradient[..3]);
    let values = params.as_slice();
    let vector = |of: &[f32], start: usize| Vec3::from_slice(&of[start..start + 3]);
    match params.kind() {
        LightKind::Sphere | LightKind::FacingDisk => lanes[6] = gradient[3] * values[3],
        LightKind::Spot | LightKind::SphereSpot => {
            lanes[6] = gradient[3] * values[3];
            [lanes[lane::CONE], lanes[lane::BLEND]] = [gradient[4], gradient[5]];
            // A turn by a small vector w moves an axis by w x axis.
            let turn = vector(values, 6).cross(vector(gradient, 6));
            lanes[lane::TURN].copy_from_slice(&turn.to_array());
        }
        LightKind::Quad | LightKind::Ellipse => {
            let (u, v) = (vector(values, 3), vector(values, 6));
            let (by_u, by_v) = (vector(gradient, 3), vector(gradient, 6));
            // Edges likewise.
            let turn = u.cross(by_u) + v.cross(by_v);
            lanes[lane::TURN].copy_from_slice(&turn.to_array());
            lanes[lane::SIZE].copy_from_slice(&[u.dot(by_u), v.dot(by_v)]);
        }
    }
    lanes
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use relume_proxy::synthetic::SyntheticRoom;
    use relume_proxy::{SizeRange, TrainConfig, Trainer};

    /// Proxy of a picture of 32 x 20 pixels, shortly trained.
    pub fn trained(kind: LightKind) -> Proxy {
        let source = SyntheticRoom::new(32, 20);
        let mut config = TrainConfig::fast(SizeRange { min: 0.1, max: 0.5 });
        config.samples = 4096;
        let mut trainer = Trainer::new(Arc::new(source.features()), kind, config, 1).unwrap();
        while !trainer.done() {
            trainer.step(&source).unwrap();
        }
        trainer.proxy().unwrap()
    }

    #[test]
    fn gradients_by_lanes_are_differences_of_a_proxy() {
        for kind in LightKind::ALL {
            let (proxy, center) = (trained(kind), Vec3::new(0.1, -0.3, 1.6));
            let light = match kind {
                LightKind::Quad | LightKind::Ellipse => {
                    LightParams::flat(kind, center, 0.3 * Vec3::Y, Vec3::new(0.35, 0.0, 0.1))
                }
                LightKind::Spot | LightKind::SphereSpot => {
                    LightParams::spot(kind, center, 0.3, [1.0, 0.6], Vec3::new(0.28, 0.0, -0.96))
                }
                _ => LightParams::round(kind, center, 0.3),
            };
            let pixels: Vec<u32> = (0..640).collect();
            let mut weights: Vec<[f32; 3]> = (0..640).map(|i| [1.0, 0.5, 0.1 * (i % 7) as f32]).collect();
            // Where a proxy's light is cut off at zero, its gradient passes that over.
            let mut lit = vec![[0.0; 3]; pixels.len()];
            proxy.forward_pixels(&pixels, &light, &mut lit).unwrap();
            let brightest = lit.as_flattened().iter().fold(0.0_f32, |most, value| most.max(*value));
            for (weight, value) in weights.as_flattened_mut().iter_mut().zip(lit.as_flattened()) {
                *weight *= f32::from(*value > 0.02 * brightest);
            }
            let value = |params: &LightParams| {
                let mut values = vec![[0.0; 3]; pixels.len()];
                proxy.forward_pixels(&pixels, params, &mut values).unwrap();
                let products = values.as_flattened().iter().zip(weights.as_flattened());
                products.map(|(value, weight)| f64::from(value * weight)).sum::<f64>()
            };
            let lanes = by_lane(&light, &proxy.backward(&pixels, &light, &weights).unwrap());
            let largest = lanes.iter().fold(0.0_f32, |most, slope| most.max(slope.abs()));
            for (number, slope) in lanes.into_iter().enumerate() {
                let at = |delta: f32| {
                    let mut step = [0.0; LANES];
                    step[number] = delta;
                    value(&LightParams::from_shape(&light.shape().moved(&step)).unwrap())
                };
                let difference = (at(5e-4) - at(-5e-4)) / 1e-3;
                let error = (difference - f64::from(slope)).abs();
                // Differences of sums over 640 pixels in single precision, and kinks of the network between the ends.
                assert!(error < 0.03 * f64::from(largest), "{kind} {number}: {difference} for {slope}");
                assert_eq!(light.shape().has_lane(number), slope != 0.0, "{kind} {number}");
            }
        }
    }
}
