use crate::{bvh::Ray, shading::Hit};

/// Hulls in a row behind which a path is given up, as in Cycles.
const MOST_HULLS: u32 = 1024;
/// Triangles that are remembered.
const RECENT: usize = 4;

/// A ray on its way through hulls. Behind one it starts a little before it, so that another hull in the same plane is met, too; the order
/// does not matter, as going in or out twice does nothing. What was just met is known again, so that the ray gets on.
#[derive(Clone, Debug, Default)]
pub(crate) struct HullCrossing {
    recent: [Option<(u32, u32)>; RECENT],
    count: u32,
}

impl HullCrossing {
    /// True if the ray passed so many that there is surely no end.
    pub fn is_worn_out(&self) -> bool {
        self.count >= MOST_HULLS
    }

    /// Takes a ray behind a hull that it hit and returns how far that is.
    pub fn pass(&mut self, ray: &mut Ray, hit: &Hit) -> f32 {
        let triangle = (hit.instance, hit.primitive);
        let size = (ray.origin + ray.direction * hit.distance).abs().max_element().max(hit.distance);
        let rounding = size * (8.0 * f32::EPSILON);
        let way = if self.recent.contains(&Some(triangle)) {
            self.recent = [None; RECENT];
            hit.distance + 2.0 * rounding
        } else {
            self.recent[self.count as usize % RECENT] = Some(triangle);
            (hit.distance - rounding).max(0.5 * hit.distance)
        };
        self.count += 1;
        ray.origin += ray.direction * way;
        ray.t_max -= way;
        ray.from = Some(triangle);
        way
    }
}
