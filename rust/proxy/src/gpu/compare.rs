use std::sync::MutexGuard;

use relume_gpu::Commands;
use relume_gpu::compare::{CompareStep, Layers, StepTargets, UnitBindings};

use super::gradient::LightGradient;
use super::proxy::{GpuProxy, SharedBuffers, grow};
use crate::{LightParams, ProxyError};

/// A loss and its gradients.
#[derive(Clone, Debug, PartialEq)]
pub struct ProxyCompared {
    /// The loss.
    pub loss: f64,
    /// Gradient of each light.
    pub lights: Vec<LightGradient>,
    /// Derivatives by the radiances of the layers but the first.
    pub layers: Vec<[f32; 3]>,
}

/// The loss of goals at some pixels of a picture of layers, the first as it is and the others times these radiances, and of lights with
/// theirs, each through the proxy of its kind; and its gradients. No picture comes back. All proxies are of the picture and the device of
/// the layers.
///
/// # Errors
/// [`ProxyError::WrongKind`] if there is no proxy for a light, [`ProxyError::PixelOutside`] or [`ProxyError::Gpu`].
///
/// # Panics
/// See [`Layers::begin`].
pub fn compare(
    proxies: &[&GpuProxy],
    layers: &Layers,
    radiances: &[[f32; 3]],
    lights: &[(LightParams, [f32; 3])],
    targets: &StepTargets,
) -> Result<ProxyCompared, ProxyError> {
    proxies.iter().try_for_each(|proxy| proxy.proxy().check_pixels(&targets.cells))?;
    let mut groups = groups(proxies, lights)?;
    let gradients = groups.iter().map(ProxyLights::gradients).sum();
    let mut commands = layers.gpu().commands("light step");
    let step = layers.begin(&mut commands, radiances, targets, gradients)?;
    for group in &mut groups {
        group.add(&mut commands, &step)?;
    }
    step.compare(&mut commands)?;
    let mut first = step.gradients().1;
    for group in &mut groups {
        group.pull(&mut commands, &step, first)?;
        first += group.gradients();
    }
    commands.submit()?;
    let compared = step.read()?;
    let mut values = &compared.gradients[..];
    let mut by_light: Vec<_> = Vec::with_capacity(lights.len());
    for group in &groups {
        let (own, rest) = values.split_at(group.gradients());
        by_light.extend(group.gradients_of(own));
        values = rest;
    }
    by_light.sort_by_key(|(number, _)| *number);
    let lights = by_light.into_iter().map(|(_, gradient)| gradient).collect();
    Ok(ProxyCompared { loss: compared.loss, lights, layers: compared.layers })
}

/// The lights of one proxy.
struct ProxyLights<'a> {
    proxy: &'a GpuProxy,
    shared: MutexGuard<'a, SharedBuffers>,
    lights: Vec<(LightParams, [f32; 3])>,
    /// Their places among all lights.
    numbers: Vec<usize>,
}

/// Lights by their proxies, in place on the device. Proxies are locked in their order, so that nobody waits for each other.
fn groups<'a>(
    proxies: &[&'a GpuProxy],
    lights: &[(LightParams, [f32; 3])],
) -> Result<Vec<ProxyLights<'a>>, ProxyError> {
    let is_of = |proxy: &GpuProxy, light: &LightParams| proxy.proxy().info().kind == light.kind();
    for (light, _) in lights {
        if let (false, Some(other)) = (proxies.iter().any(|proxy| is_of(proxy, light)), proxies.first()) {
            other.proxy().check_kind(light)?;
        }
    }
    let mut groups = Vec::new();
    for proxy in proxies {
        let own = |(number, light): (usize, &(LightParams, [f32; 3]))| {
            is_of(proxy, &light.0).then_some((number, *light))
        };
        let (numbers, lights): (Vec<_>, Vec<_>) = lights.iter().enumerate().filter_map(own).unzip();
        if !lights.is_empty() {
            let mut shared = proxy.shared();
            proxy.write_lights(&mut shared, &lights)?;
            groups.push(ProxyLights { proxy, shared, lights, numbers });
        }
    }
    Ok(groups)
}

impl ProxyLights<'_> {
    /// Values of the gradients of all of its lights.
    fn gradients(&self) -> usize {
        self.lights.len() * self.proxy.gradient_len()
    }

    /// Appends what adds its lights to the picture.
    fn add(&mut self, commands: &mut Commands<'_>, step: &CompareStep<'_>) -> Result<(), ProxyError> {
        let (proxy, shared, lights) = (self.proxy, &mut *self.shared, self.lights.len());
        for part in step.parts(proxy.batch(lights)) {
            grow(proxy.gpu(), &mut shared.units, 3 * part.len() * lights)?;
            proxy.add_pixels(commands, shared, step.cells(part.clone()), part.len())?;
            proxy.add_units(commands, shared, lights, part.len())?;
            let radiances = (shared.lights.whole(), proxy.light_len() / 4);
            let values = (shared.units.whole(), 1);
            step.add(commands, &UnitBindings { lights, radiances, first: 0, values, all: None }, part)?;
        }
        Ok(())
    }

    /// Appends what adds its gradients to the values from `first` on.
    fn pull(
        &mut self,
        commands: &mut Commands<'_>,
        step: &CompareStep<'_>,
        first: usize,
    ) -> Result<(), ProxyError> {
        let (proxy, shared, lights) = (self.proxy, &mut *self.shared, self.lights.len());
        let parts = step.parts(proxy.batch(lights));
        for part in &parts {
            // The last part is still there.
            if parts.len() > 1 {
                proxy.add_pixels(commands, shared, step.cells(part.clone()), part.len())?;
            }
            let d_picture = step.d_picture(part.clone());
            let results = (step.gradients().0, first);
            proxy.add_gradients(commands, shared, lights, part.len(), d_picture, results)?;
        }
        Ok(())
    }

    /// Each light's number and gradient, from the values of all.
    fn gradients_of<'b>(&'b self, values: &'b [f32]) -> impl Iterator<Item = (usize, LightGradient)> + 'b {
        let gradient = |(light, values)| self.proxy.light_gradient(light, values);
        let values = values.chunks_exact(self.proxy.gradient_len());
        self.numbers.iter().copied().zip(self.lights.iter().zip(values).map(gradient))
    }
}
