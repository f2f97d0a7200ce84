use glam::Vec2;
use serde::{Deserialize, Serialize};

/// Part of a picture: the union of strokes, a rectangle and a mask. Places are fractions of the picture, (0, 0) its top left
/// corner, so that a region serves every resolution.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Region {
    /// Strokes in the order in which they were painted; those that erase take away from the ones before.
    pub strokes: Vec<Stroke>,
    /// Left, top, right, bottom.
    pub rectangle: Option<[f32; 4]>,
}

/// A stroke of a round brush with a soft edge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stroke {
    /// Radius of the brush at full pressure, as a fraction of the picture's height.
    pub radius: f32,
    /// Weight at full pressure, 0..1.
    #[serde(default = "one")]
    pub strength: f32,
    /// Takes away instead of adding.
    #[serde(default)]
    pub erase: bool,
    /// x, y and pressure (0..1) of each point.
    pub points: Vec<[f32; 3]>,
}

fn one() -> f32 {
    1.0
}

/// Share of a brush's radius over which its edge fades.
const EDGE: f32 = 0.3;

impl Region {
    /// Weight of each pixel, 0..1, row by row from the top. `mask` is added as it is.
    pub fn weights(&self, (width, height): (usize, usize), mask: Option<&[f32]>) -> Vec<f32> {
        let mut weights = match mask {
            Some(mask) => mask.iter().map(|value| value.clamp(0.0, 1.0)).collect(),
            None => vec![0.0; width * height],
        };
        if let Some([left, top, right, bottom]) = self.rectangle {
            let columns = pixels(left.min(right), left.max(right), width);
            for y in pixels(top.min(bottom), top.max(bottom), height) {
                weights[y * width..][columns.clone()].fill(1.0);
            }
        }
        for stroke in &self.strokes {
            stroke.paint(&mut weights, (width, height));
        }
        weights
    }

    /// Fault of the region, in words.
    pub fn fault(&self) -> Option<&'static str> {
        let is_place = |value: &f32| value.is_finite() && value.abs() <= 10.0;
        let mut numbers = self.strokes.iter().flat_map(|stroke| stroke.points.as_flattened());
        if !numbers.all(is_place) || !self.rectangle.iter().flatten().all(is_place) {
            return Some("a place is not a fraction of the picture");
        }
        let is_brush =
            |stroke: &Stroke| (0.0..=10.0).contains(&stroke.radius) && (0.0..=1.0).contains(&stroke.strength);
        (!self.strokes.iter().all(is_brush)).then_some("a brush has no radius, or a strength beyond 0 to 1")
    }
}

/// Pixels whose middle lies between two fractions.
fn pixels(from: f32, to: f32, count: usize) -> std::ops::Range<usize> {
    let at = |fraction: f32| ((fraction * count as f32 + 0.5).floor().max(0.0) as usize).min(count);
    at(from)..at(to).max(at(from))
}

impl Stroke {
    fn paint(&self, weights: &mut [f32], (width, height): (usize, usize)) {
        let scale = Vec2::new(width as f32, height as f32);
        let at = |point: &[f32; 3]| (Vec2::new(point[0], point[1]) * scale, point[2].clamp(0.0, 1.0));
        let radius = self.radius * height as f32;
        let ends: Vec<_> = self.points.iter().map(at).collect();
        let pairs = ends.windows(2).map(|pair| (pair[0], pair[1]));
        for (a, b) in pairs.chain(ends.first().filter(|_| ends.len() == 1).map(|end| (*end, *end))) {
            let (low, high) = (a.0.min(b.0) - radius, a.0.max(b.0) + radius);
            let (columns, rows) = (reach(low.x, high.x, width), reach(low.y, high.y, height));
            for y in rows {
                for x in columns.clone() {
                    let point = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    let weight = self.strength * brush(point, a, b, radius);
                    let to = &mut weights[y * width + x];
                    *to = if self.erase { to.min(1.0 - weight) } else { to.max(weight) };
                }
            }
        }
    }
}

fn reach(low: f32, high: f32, count: usize) -> std::ops::Range<usize> {
    let at = |value: f32| (value.max(0.0) as usize).min(count);
    at(low)..at(high + 1.0)
}

/// Weight of a brush of this radius, thinner where the pressure is lower, that was drawn from `a` to `b`.
fn brush(point: Vec2, a: (Vec2, f32), b: (Vec2, f32), radius: f32) -> f32 {
    let along = b.0 - a.0;
    let t = ((point - a.0).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
    let radius = radius * (a.1 + t * (b.1 - a.1));
    let distance = point.distance(a.0 + t * along);
    ((radius - distance) / (EDGE * radius).max(0.5) + 0.5).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stroke(points: &[[f32; 3]], erase: bool) -> Stroke {
        Stroke { radius: 0.1, strength: 1.0, erase, points: points.to_vec() }
    }

    #[test]
    fn strokes_cover_what_they_pass_and_erasers_take_it_away() {
        let line = stroke(&[[0.25, 0.5, 1.0], [0.75, 0.5, 1.0]], false);
        let eraser = stroke(&[[0.75, 0.5, 1.0]], true);
        let region = Region { strokes: vec![line, eraser], rectangle: None };
        let weights = region.weights((80, 40), None);
        let at = |x: usize, y: usize| weights[y * 80 + x];
        assert_eq!((at(20, 20), at(40, 20), at(60, 20)), (1.0, 1.0, 0.0));
        assert_eq!((at(40, 26), at(10, 20), at(40, 5)), (0.0, 0.0, 0.0));
    }

    #[test]
    fn rectangles_hold_the_pixels_whose_middle_they_hold() {
        let region = Region { strokes: vec![], rectangle: Some([0.75, 0.5, 0.25, 1.0]) };
        let weights = region.weights((8, 4), None);
        assert_eq!(weights.iter().sum::<f32>(), 8.0);
        assert_eq!(weights[2 * 8 + 2..][..4], [1.0; 4]);
    }

    #[test]
    fn strokes_outside_of_the_picture_paint_nothing_and_do_not_fail() {
        let region =
            Region { strokes: vec![stroke(&[[-3.0, 9.0, 1.0], [-4.0, 9.5, 0.0]], false)], rectangle: None };
        assert!(region.fault().is_none());
        assert_eq!(region.weights((8, 4), None).iter().sum::<f32>(), 0.0);
        let wild = Region { strokes: vec![stroke(&[[f32::NAN, 0.0, 1.0]], false)], rectangle: None };
        assert!(wild.fault().is_some());
    }
}
