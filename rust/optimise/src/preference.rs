use crate::variable::{Mapping, PARAMS, Variable, coordinate, luminance, power};
use glam::{Mat3, Quat, Vec3};
use relume_scene::{LANES, Light, LightShape, lane};

/// Distance of a light from where it started, as residuals, each with its derivatives by the light's unconstrained
/// values.
pub(crate) fn residuals(variable: &Variable, mapping: &Mapping, light: &Light) -> Vec<(f32, [f32; PARAMS])> {
    if variable.prior_weight <= 0.0 {
        return Vec::new();
    }
    let weight = variable.prior_weight.sqrt();
    let (home, now) = (&variable.light, light);
    let reach = (variable.bounds.center_max - variable.bounds.center_min).length();
    let by = |number: usize, scale: f32| {
        let mut d_shape = [0.0; LANES];
        d_shape[number] = weight * scale;
        mapping.pull_back(light, &d_shape, [0.0; 3])
    };
    let mut all = Vec::new();
    if let (Some(from), Some(to)) = (home.shape.center(), now.shape.center()) {
        let moved = (to - from) / reach;
        all.extend((0..3).map(|i| (weight * moved[i], by(i, 1.0 / reach))));
    }
    if let Some(turn) = turn(&home.shape, &now.shape) {
        // The derivative of a rotation vector by a further small turn is the identity to first order.
        all.extend(lane::TURN.map(|i| (weight * turn[i - lane::TURN.start], by(i, 1.0))));
    }
    let (from, to) = (home.shape.sizes(), now.shape.sizes());
    for i in lane::SIZE.filter(|i| now.shape.has_lane(*i)) {
        let k = i - lane::SIZE.start;
        all.push((weight * (to[k] / from[k]).ln(), by(i, 1.0)));
    }
    for i in [lane::CONE, lane::BLEND].into_iter().filter(|i| now.shape.has_lane(*i)) {
        all.push((weight * (coordinate(&now.shape, i) - coordinate(&home.shape, i)), by(i, 1.0)));
    }
    all.extend(tints(home, now).into_iter().map(|(tint, d_radiance)| {
        (weight * tint, mapping.pull_back(light, &[0.0; LANES], d_radiance.map(|d| weight * d)))
    }));
    let (from, to) = (luminance(power(home)), luminance(power(now)));
    if from > 0.0 && to > 0.0 {
        let share = weight * now.shape.extent() / to;
        let d_radiance = crate::variable::LUMINANCE.map(|w| w * share);
        let mut row = mapping.pull_back(light, &[0.0; LANES], d_radiance);
        // Power does not change with size, so the part of the radiance's fall cancels.
        lane::SIZE.for_each(|i| row[i] = 0.0);
        all.push((weight * (to / from).ln(), row));
    }
    all
}

/// Logarithms of the factors by which red and blue have changed beside green, with their derivatives by radiance; less what is black.
fn tints(home: &Light, now: &Light) -> Vec<(f32, [f32; 3])> {
    let ratio = |light: &Light, c: usize| light.radiance[c] / light.radiance[1];
    let is_lit =
        |c: &usize| [home, now].iter().all(|light| light.radiance[1] > 0.0 && light.radiance[*c] > 0.0);
    let tint = |c: usize| {
        let mut d_radiance = [0.0; 3];
        (d_radiance[c], d_radiance[1]) = (1.0 / now.radiance[c], -1.0 / now.radiance[1]);
        ((ratio(now, c) / ratio(home, c)).ln(), d_radiance)
    };
    [0, 2].into_iter().filter(is_lit).map(tint).collect()
}

/// Rotation vector from one shape's orientation to another's. An area light turned by half in its plane is the same.
fn turn(from: &LightShape, to: &LightShape) -> Option<Vec3> {
    let axis = |shape: &LightShape| match *shape {
        LightShape::Spot { axis, .. } => axis.try_normalize(),
        LightShape::Sun { direction, .. } => direction.try_normalize(),
        _ => None,
    };
    if let (Some(from), Some(to)) = (axis(from), axis(to)) {
        return Some(Quat::from_rotation_arc(from, to).to_scaled_axis());
    }
    let frame = |shape: &LightShape| match *shape {
        LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
            let (u, normal) = (edge_u.try_normalize()?, edge_u.cross(edge_v).try_normalize()?);
            Some(Mat3::from_cols(u, normal.cross(u), normal))
        }
        _ => None,
    };
    let (from, to) = (frame(from)?, frame(to)?);
    let turned = Mat3::from_cols(-to.x_axis, -to.y_axis, to.z_axis);
    let [a, b] =
        [to, turned].map(|to| Quat::from_mat3(&(to * from.transpose())).normalize().to_scaled_axis());
    Some(if b.length() < a.length() { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{lamps, variable};

    #[test]
    fn whatever_changes_of_a_light_costs() {
        for lamp in lamps() {
            let variable = Variable { prior_weight: 1.0, ..variable(&lamp) };
            let mapping = Mapping { bounds: variable.bounds, locks: variable.locks, power_unit: 1.0 };
            let cost = |light: &Light| {
                residuals(&variable, &mapping, light).iter().map(|(value, _)| value * value).sum::<f32>()
            };
            assert!(cost(&lamp) < 1e-9, "{lamp:?}");
            for number in 0..PARAMS {
                let mut step = [0.0; PARAMS];
                step[number] = 0.3;
                let moved = mapping.step(&lamp, &step);
                let is_other =
                    format!("{:.3?}", moved.shape) != format!("{:.3?}", lamp.shape) || number >= LANES;
                assert!(!is_other || cost(&moved) > 1e-5, "{number}: {} of {moved:?}", cost(&moved));
            }
        }
    }

    #[test]
    fn an_area_light_turned_by_half_is_where_it_was() {
        let shape = |sign: f32| LightShape::Quad {
            center: Vec3::ZERO,
            edge_u: sign * Vec3::X,
            edge_v: 2.0 * sign * Vec3::Y,
            spread: 1.0,
        };
        assert!(turn(&shape(1.0), &shape(-1.0)).unwrap().length() < 1e-3);
        assert!(
            turn(&shape(1.0), &shape(1.0).moved(&std::array::from_fn(|i| f32::from(u8::from(i == 5)))))
                .unwrap()
                .length()
                > 0.9
        );
    }
}
