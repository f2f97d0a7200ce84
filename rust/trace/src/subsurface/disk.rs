//! Probes of the surface around, by Christensen and Burley's profile ("Approximate Reflectance Profiles for Efficient
//! Subsurface Scattering", Pixar technical memo 15-04), along one of three axes (King et al., see above).

use std::f32::consts::TAU;

use glam::Vec3;

use super::BodyExit;
use crate::{
    bsdf::ShadingFrame,
    bvh::Ray,
    shading::{Hit, SurfacePoint},
};

/// Radii at which the profile ends.
const REACH: f32 = 16.0;
/// Share of the profile within that reach: `1 - exp(-16) / 4 - 3/4 exp(-16 / 3)`.
const SHARE_WITHIN: f32 = 0.996_379;
/// Most surfaces that a probe looks at.
const MOST_HITS: usize = 64;
/// Probability of each axis: the normal and two tangents.
const AXES: [f32; 3] = [0.5, 0.25, 0.25];

/// A place that light from `point` leaves the body at, chosen from all that a line meets; nothing if it meets none.
pub(super) fn probe(
    radius: Vec3,
    point: &SurfacePoint,
    throughput: Vec3,
    u: [f32; 4],
    find: impl Fn(&Ray) -> Option<Hit>,
) -> Option<BodyExit> {
    let frame = ShadingFrame::from_normal(point.geometric_normal);
    let axes = [Vec3::Z, Vec3::X, Vec3::Y].map(|axis| frame.world(axis));
    let (chosen, turn) = match u[1] {
        u if u < 0.5 => (0, 2.0 * u),
        u if u < 0.75 => (1, 4.0 * u - 2.0),
        u => (2, 4.0 * u - 3.0),
    };
    let (axis, across) = (axes[chosen], [axes[(chosen + 1) % 3], axes[(chosen + 2) % 3]]);
    let (reach, from_axis) = sample_radius(radius, u[0])?;
    let height = (reach * reach - from_axis * from_axis).max(0.0).sqrt();
    let (sin, cos) = (TAU * turn).sin_cos();
    let start = point.position + axis * height + (across[0] * cos + across[1] * sin) * from_axis;
    let mut ray = Ray { t_max: 2.0 * height, ..Ray::new(start, -axis).at(point.time) };

    // Of all hits, one in proportion to its weight: no more than one is kept at a time.
    let (mut rest, mut sum, mut kept) = (u[2], 0.0, None);
    for _ in 0..MOST_HITS {
        let Some(hit) = find(&ray) else { break };
        ray.t_min = hit.distance;
        let position = start - axis * hit.distance;
        let normal = hit.front.normalize_or(axis);
        let densities: [f32; 3] = std::array::from_fn(|axis| AXES[axis] * axes[axis].dot(normal).abs());
        // The power heuristic over the density of the axis that was chosen.
        let share = densities[chosen] / densities.iter().map(|density| density * density).sum::<f32>();
        let weight = profile(radius, position.distance(point.position)) * share;
        let mean = weight.element_sum() / 3.0;
        if !(mean > 0.0 && mean.is_finite()) {
            continue;
        }
        sum += mean;
        let probability = mean / sum;
        if rest < probability {
            rest /= probability;
            let outwards = if point.backfacing { -normal } else { normal };
            kept = Some(BodyExit { hit, position, outwards, throughput: weight / mean });
        } else {
            rest = (rest - probability) / (1.0 - probability);
        }
    }
    let kept = kept?;
    let throughput = throughput * kept.throughput * (sum / density(radius, from_axis));
    throughput.is_finite().then_some(BodyExit { throughput, ..kept })
}

/// Reach of the profile of a channel that takes part, and a distance from the axis with [`density`].
fn sample_radius(radius: Vec3, u: f32) -> Option<(f32, f32)> {
    let mut channels = radius.to_array().into_iter().filter(|radius| *radius > 0.0);
    let scaled = u * channels.clone().count() as f32;
    let chosen = channels.clone().nth(scaled as usize).or(channels.next_back())?;
    // The inverse of 1 - y^3 / 4 - 3 y / 4 with y = exp(-r / 3), by Cardano's formula.
    let beyond = 2.0 * (1.0 - scaled.fract() * SHARE_WITHIN);
    let root = (beyond + (beyond * beyond + 1.0).sqrt()).cbrt();
    let distance = -3.0 * (root - 1.0 / root).ln();
    Some((REACH * chosen, chosen * distance.clamp(0.0, REACH)))
}

/// Density of [`sample_radius`]: over the radius, not over area.
fn density(radius: Vec3, distance: f32) -> f32 {
    let channels = radius.cmpgt(Vec3::ZERO).bitmask().count_ones();
    profile(radius, distance).element_sum() / channels as f32
}

/// Radial profile of each channel, `exp(-r / d) + exp(-r / 3 d)` over `4 d`, to its reach.
fn profile(radius: Vec3, distance: f32) -> Vec3 {
    radius.map(|radius| {
        let scaled = distance / radius;
        // False also where both are 0.
        if !(distance > 0.0 && scaled < REACH) {
            return 0.0;
        }
        let third = (-scaled / 3.0).exp();
        (third * third * third + third) / (4.0 * SHARE_WITHIN * radius)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_fall_as_often_as_the_profile_says() {
        let radius = Vec3::new(0.5, 0.0, 0.02);
        let count = 20_000;
        let mut radii: Vec<f32> =
            (0..count).map(|i| sample_radius(radius, (i as f32 + 0.5) / count as f32).unwrap().1).collect();
        radii.sort_by(f32::total_cmp);
        // The density, summed up in small steps, against the share of smaller radii.
        let (step, mut share) = (1e-4, 0.0);
        for i in 0..80_000 {
            let r = (i as f32 + 0.5) * step;
            share += density(radius, r) * step;
            if i % 8_000 == 0 {
                let found = radii.partition_point(|other| *other < r) as f32 / count as f32;
                assert!((found - share).abs() < 2e-3, "radius {r}: {found}, not {share}");
            }
        }
        assert!((share - 1.0).abs() < 2e-3, "{share}");
    }
}
