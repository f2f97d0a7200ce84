use crate::variable::{Mapping, PARAMS, Variable, luminance, power};
use glam::Vec3;
use relume_scene::{LANES, Light, LightShape, lane};

/// How far a light is from where it started, as residuals, each with its derivatives by the light's unconstrained values.
pub(crate) fn residuals(variable: &Variable, mapping: &Mapping, light: &Light) -> Vec<(f32, [f32; PARAMS])> {
    if variable.stay <= 0.0 {
        return Vec::new();
    }
    let weight = variable.stay.sqrt();
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

/// Rotation vector from one shape's orientation to another's.
fn turn(from: &LightShape, to: &LightShape) -> Option<Vec3> {
    let [a, b] = [from, to].map(|shape| match *shape {
        LightShape::Spot { axis, .. } => Some(axis),
        LightShape::Sun { direction, .. } => Some(direction),
        LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
            edge_u.cross(edge_v).try_normalize()
        }
        _ => None,
    });
    Some(glam::Quat::from_rotation_arc(a?.normalize(), b?.normalize()).to_scaled_axis())
}
