//! Notes on lights whose pictures are slower or less exact than usual, in words for the user.

use crate::bake::guiding::GuideCoverage;
use crate::device::gather::DeviceGather;
use crate::files::proxies::Proxies;
use relume_gather::Gather;
use relume_proxy::{HALF_ANGLES, LightKind};
use relume_scene::{Light, LightShape};

/// Warnings about the lights of a picture.
#[derive(Default)]
pub(crate) struct LightNotes {
    pub warnings: Vec<String>,
    /// Names of lights that hardly any path meets, while guided paths would.
    pub under_sampled: Vec<String>,
}

impl LightNotes {
    /// Notes faults of a gathered light: too small for the dump, or met by too few paths. One that is connected to vertices has
    /// neither.
    pub fn add_gathered(&mut self, light: &Light, gather: &DeviceGather, coverage: Option<&GuideCoverage>) {
        if gather.connects(light) {
            return;
        }
        self.warnings.extend(too_small(gather.gather(), light));
        if let Some(under_sampled) = coverage.and_then(|coverage| coverage.under_sampled(light)) {
            self.warnings.push(under_sampled.warning(light));
            self.under_sampled.extend(under_sampled.guiding_helps.then(|| light.name.clone()));
        }
    }
}

/// Warning about a light below the resolution of a dump's positions, which falls with the distance of the farthest vertex that
/// a tile sees.
fn too_small(gather: &Gather, light: &Light) -> Option<String> {
    /// Metres. Penumbras of larger lights show.
    const SHOWS: f32 = 5e-3;
    let radius = gather.enlarged(&light.shape).filter(|radius| *radius > SHOWS)?;
    Some(format!(
        "light '{}' is too small for this bake and lights as if it were {:.0} mm across; what lies that close to it may lose \
         some of its light. Hide or shrink what is far away (a ground plane, a backdrop), and bake again",
        light.name,
        2000.0 * radius
    ))
}

/// Warning about a light that a proxy extrapolates to.
pub(crate) fn extrapolated(light: &Light, proxies: &Proxies) -> Option<String> {
    let text =
        format!("light '{}' is outside of where its proxy has learned; what it shows is a guess", light.name);
    proxies.knowing(light).is_none().then_some(text)
}

/// Note on a gathered light whose kind has a proxy that did not learn its size or place.
pub(crate) fn outside_of_training(light: &Light, proxies: &Proxies) -> Option<String> {
    let info = proxies.of(LightKind::of_light(light)?)?.proxy.info();
    if proxies.knowing(light).is_some() {
        return None;
    }
    let reason = if proxies.covering(light).is_none() {
        let (min, max) = (info.size.min, info.size.max);
        let cone = match light.shape {
            LightShape::Spot { .. } => {
                format!("spot sizes from {:.0} degrees on, ", 2.0 * HALF_ANGLES[0].to_degrees())
            }
            _ => String::new(),
        };
        format!("sizes of {min:.2} to {max:.2} m, {cone}usual ray visibility, no light linking")
    } else {
        let range = |axis: usize| {
            let [least, greatest] = info.trained_ranges[axis];
            format!("{least:.2} to {greatest:.2}")
        };
        format!("places of x {}, y {}, z {} m", range(0), range(1), range(2))
    };
    Some(format!(
        "light '{}' is not among what its proxy has learned ({reason}); it is summed from the samples, which is slower",
        light.name
    ))
}

/// Note on gathered lights of kinds without a proxy.
pub(crate) fn without_proxy(names: &[&str]) -> Option<String> {
    let named = match names {
        [] => return None,
        [one] => format!("'{one}'"),
        [one, other] => format!("'{one}' and '{other}'"),
        [one, other, more @ ..] => format!("'{one}', '{other}' and {} more", more.len()),
    };
    Some(format!(
        "no proxy has learned lights such as {named} (only points, spots, and area lights of full spread, ever are): they \
         are summed from the samples, which is slower"
    ))
}
