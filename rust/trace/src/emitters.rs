//! Emissive triangles, chosen in proportion to their power.

use std::collections::HashMap;

use glam::Vec3;
use relume_scene::{HairModel, Input, Instance, Material, Mesh, Node, STILL, Scene};

use crate::{
    bsdf::Surface,
    discrete::Discrete1D,
    shading::{Hit, PreparedMaterials, RayInfo, SurfacePoint},
};

/// Points of a triangle whose emission differs from place to place.
const POINTS_WHERE_IT_VARIES: usize = 16;

/// All triangles that emit light.
#[derive(Debug)]
pub(crate) struct Emitters {
    triangles: Vec<Emitter>,
    choice: Discrete1D,
    /// Index of an emitter by instance and triangle.
    by_triangle: HashMap<(u32, u32), u32>,
}

#[derive(Clone, Copy, Debug)]
struct Emitter {
    instance: u32,
    triangle: u32,
    /// In the middle of the shutter's interval.
    place: Place,
    /// True if it moves.
    moves: bool,
    /// Largest channel of the radiance that was found on it, of the brighter side.
    brightness: f32,
}

/// A point on an emitter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EmitterSample {
    pub instance: u32,
    pub triangle: u32,
    pub position: Vec3,
    /// Density over area, choice of the triangle included.
    pub area_density: f32,
    /// Unit normal of the triangle.
    pub normal: Vec3,
    /// About the largest channel of the radiance.
    pub brightness: f32,
}

/// A triangle in world space.
#[derive(Clone, Copy, Debug)]
struct Place {
    corner: Vec3,
    edge_1: Vec3,
    edge_2: Vec3,
}

impl Place {
    /// Place of a triangle of an instance at a time.
    fn at(instance: &Instance, mesh: &Mesh, triangle: usize, time: f32) -> Self {
        let world_from_object = instance.world_from_object_at(time);
        let [a, b, c] =
            mesh.corners_at(triangle, time).map(|corner| world_from_object.transform_point3(corner));
        Self { corner: a, edge_1: b - a, edge_2: c - a }
    }

    fn cross(&self) -> Vec3 {
        self.edge_1.cross(self.edge_2)
    }
}

impl Emitter {
    fn place_at(&self, scene: &Scene, time: f32) -> Place {
        let instance = &scene.instances[self.instance as usize];
        match scene.mesh(instance.geometry).filter(|_| self.moves) {
            Some(mesh) => Place::at(instance, mesh, self.triangle as usize, time),
            None => self.place,
        }
    }
}

impl Emitters {
    /// Finds the emitters; nothing if there are none. Only instances that all rays see take part, since a light sample
    /// does not know what kind of ray it stands for; others are left to BSDF sampling. So are strands and points: few glow.
    pub fn new(scene: &Scene, materials: &PreparedMaterials) -> Option<Self> {
        let points_by_material: Vec<usize> = scene.materials.iter().map(points_to_measure).collect();
        let mut surface = Surface::default();
        let (mut triangles, mut powers) = (Vec::new(), Vec::new());
        for (index, instance) in scene.instances.iter().enumerate() {
            if !is_seen_by_all(instance) {
                continue;
            }
            let Some(mesh) = scene.mesh(instance.geometry) else { continue };
            let moves = !instance.motion.is_empty() || !mesh.motion.is_empty();
            for number in 0..mesh.triangles.len() {
                let material = instance.material_of(scene, number);
                let points = material.map_or(0, |material| points_by_material[material]);
                if points == 0 {
                    continue;
                }
                let mut emitter = Emitter {
                    instance: index as u32,
                    triangle: number as u32,
                    place: Place::at(instance, mesh, number, STILL),
                    moves,
                    brightness: 0.0,
                };
                let asks_light_path =
                    material.is_some_and(|number| scene.materials[number].asks_light_path());
                // What glows for some kinds of rays only is sampled for all, as in Cycles.
                let rays = &[RayInfo::default(), RayInfo::OF_ALL_KINDS][..=usize::from(asks_light_path)];
                let power = emitter.measure(scene, materials, points, rays, &mut surface);
                if power > 0.0 {
                    triangles.push(emitter);
                    powers.push(power);
                }
            }
        }
        let choice = Discrete1D::new(&powers)?;
        let key = |emitter: &Emitter| (emitter.instance, emitter.triangle);
        let by_triangle =
            triangles.iter().enumerate().map(|(index, emitter)| (key(emitter), index as u32)).collect();
        Some(Self { triangles, choice, by_triangle })
    }

    /// A point on a triangle at a time, uniform over its area.
    pub fn sample(&self, u: [f32; 3], scene: &Scene, time: f32) -> EmitterSample {
        let index = self.choice.sample(u[0]);
        let emitter = &self.triangles[index];
        let place = emitter.place_at(scene, time);
        let root = u[1].sqrt();
        let position = place.corner + place.edge_1 * (1.0 - root) + place.edge_2 * (u[2] * root);
        let cross = place.cross();
        EmitterSample {
            instance: emitter.instance,
            triangle: emitter.triangle,
            position,
            area_density: self.choice.probability(index) * 2.0 / cross.length(),
            normal: cross.normalize_or(Vec3::Z),
            brightness: emitter.brightness,
        }
    }

    /// True if [`Emitters::sample`] gives points of the triangle that a point is on.
    pub fn have(&self, point: &SurfacePoint) -> bool {
        self.by_triangle.contains_key(&(point.instance, point.primitive))
    }

    /// Density over area with which [`Emitters::sample`] gives points of the triangle that a point is on; 0 if it gives none.
    pub fn area_density(&self, scene: &Scene, point: &SurfacePoint) -> f32 {
        self.by_triangle.get(&(point.instance, point.primitive)).map_or(0.0, |&index| {
            let place = self.triangles[index as usize].place_at(scene, point.time);
            self.choice.probability(index as usize) * 2.0 / place.cross().length()
        })
    }
}

impl Emitter {
    /// Evaluates both sides at so many points for some rays, and returns the mean of their sum times the area. Where all points of
    /// an image happen to be black, it is left to BSDF sampling.
    fn measure(
        &mut self,
        scene: &Scene,
        materials: &PreparedMaterials,
        points: usize,
        rays: &[RayInfo],
        surface: &mut Surface,
    ) -> f32 {
        let cross = self.place.cross();
        let area = 0.5 * cross.length();
        if !(area > 0.0 && area.is_finite()) {
            return 0.0;
        }
        let normal = cross / (2.0 * area);
        let mut sum = 0.0;
        for barycentrics in spread_points(points) {
            let Place { corner, edge_1, edge_2 } = self.place;
            let position = corner + edge_1 * barycentrics[0] + edge_2 * barycentrics[1];
            for wo in [normal, -normal] {
                let hit = Hit::on(scene, [self.instance, self.triangle], barycentrics, 1.0);
                let met = materials.surface_point(scene, &hit, position + wo, -wo, 0.0);
                let brightness = rays.iter().fold(0.0, |brightest: f32, &ray| {
                    materials.evaluate(scene, &SurfacePoint { ray, ..met }, surface);
                    brightest.max(surface.emission().max_element())
                });
                sum += brightness;
                self.brightness = self.brightness.max(brightness);
            }
        }
        sum / points as f32 * area
    }
}

/// Barycentric coordinates of points that are spread evenly over a triangle (Roberts's sequence, folded), the first in the
/// middle.
fn spread_points(count: usize) -> impl Iterator<Item = [f32; 2]> {
    (0..count).map(|i| {
        let [u, v] = [0.754_877_7, 0.569_840_3].map(|step| (1.0 / 3.0 + i as f32 * step).fract());
        if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] }
    })
}

fn is_seen_by_all(instance: &Instance) -> bool {
    instance.visible_camera
        && instance.visible_diffuse
        && instance.visible_glossy
        && instance.visible_transmission
        && instance.visible_shadow
}

/// Number of points of a triangle at which a material's emission is to be measured, judged by its nodes: none if it
/// cannot emit.
fn points_to_measure(material: &Material) -> usize {
    if material.unsampled_emission {
        return 0;
    }
    let is_zero = |input: &Input| match input {
        Input::Float(value) => *value == 0.0,
        Input::Rgb(color) => *color == [0.0; 3],
        Input::Link { .. } => false,
    };
    let emits = material.nodes.iter().any(|node| match node {
        Node::Emission { color, strength } => !is_zero(color) && !is_zero(strength),
        Node::Principled { emission_color, emission_strength, .. } => {
            !is_zero(emission_color) && !is_zero(emission_strength)
        }
        _ => false,
    });
    let mut varies = false;
    for node in &material.nodes {
        node.clone().for_each_input(|input| varies |= matches!(input, Input::Link { .. }));
    }
    match (emits, varies) {
        (false, _) => 0,
        (true, false) => 1,
        (true, true) => POINTS_WHERE_IT_VARIES,
    }
}

/// True if light can go straight through a material, judged by its nodes.
pub(crate) fn may_be_transparent(material: &Material) -> bool {
    material.nodes.iter().any(|node| match node {
        Node::Transparent { .. } => true,
        // Rays pass beside an ellipse.
        Node::PrincipledHair(hair) => {
            hair.model == HairModel::Huang && hair.aspect_ratio != Input::Float(1.0)
        }
        Node::Principled { alpha, thin_wall, transmission_weight, .. } => {
            let is_pane = thin_wall.is_some() && *transmission_weight != Input::Float(0.0);
            *alpha != Input::Float(1.0) || is_pane
        }
        _ => false,
    })
}
