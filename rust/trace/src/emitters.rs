//! Emissive triangles, chosen in proportion to their power.

use std::collections::HashMap;

use glam::Vec3;
use relume_scene::{Input, Instance, Material, Node, Scene};

use crate::{
    bsdf::Surface,
    distribution::Distribution,
    shading::{Hit, PreparedMaterials},
};

/// All triangles that emit light.
#[derive(Debug)]
pub(crate) struct Emitters {
    triangles: Vec<Emitter>,
    choice: Distribution,
    /// Index of an emitter by instance and triangle.
    by_triangle: HashMap<(u32, u32), u32>,
}

#[derive(Clone, Copy, Debug)]
struct Emitter {
    instance: u32,
    triangle: u32,
    /// World space.
    corner: Vec3,
    edge_1: Vec3,
    edge_2: Vec3,
    /// Largest channel of the radiance in the middle, of the brighter side.
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

impl Emitter {
    fn cross(&self) -> Vec3 {
        self.edge_1.cross(self.edge_2)
    }
}

impl Emitters {
    /// Finds the emitters; nothing if there are none. Only instances that all rays see take part, since a light sample
    /// does not know what kind of ray it stands for; others are left to BSDF sampling.
    pub fn new(scene: &Scene, materials: &PreparedMaterials) -> Option<Self> {
        let may_emit: Vec<bool> = scene.materials.iter().map(may_emit).collect();
        let mut surface = Surface::default();
        let (mut triangles, mut powers) = (Vec::new(), Vec::new());
        for (index, instance) in scene.instances.iter().enumerate() {
            let emits = instance.materials.iter().any(|material| may_emit.get(*material) == Some(&true));
            if !emits || !is_seen_by_all(instance) {
                continue;
            }
            let mesh = &scene.meshes[instance.mesh];
            for (number, triangle) in mesh.triangles.iter().enumerate() {
                let [a, b, c] = triangle.map(|vertex| {
                    instance.world_from_object.transform_point3(mesh.positions[vertex as usize])
                });
                let mut emitter = Emitter {
                    instance: index as u32,
                    triangle: number as u32,
                    corner: a,
                    edge_1: b - a,
                    edge_2: c - a,
                    brightness: 0.0,
                };
                let power = emitter.measure(scene, materials, &mut surface);
                if power > 0.0 {
                    triangles.push(emitter);
                    powers.push(power);
                }
            }
        }
        let choice = Distribution::new(&powers)?;
        let key = |emitter: &Emitter| (emitter.instance, emitter.triangle);
        let by_triangle =
            triangles.iter().enumerate().map(|(index, emitter)| (key(emitter), index as u32)).collect();
        Some(Self { triangles, choice, by_triangle })
    }

    /// A point on a triangle, uniform over its area.
    pub fn sample(&self, u: [f32; 3]) -> EmitterSample {
        let index = self.choice.sample(u[0]);
        let emitter = &self.triangles[index];
        let root = u[1].sqrt();
        let position = emitter.corner + emitter.edge_1 * (1.0 - root) + emitter.edge_2 * (u[2] * root);
        let cross = emitter.cross();
        EmitterSample {
            instance: emitter.instance,
            triangle: emitter.triangle,
            position,
            area_density: self.choice.probability(index) * 2.0 / cross.length(),
            normal: cross.normalize_or(Vec3::Z),
            brightness: emitter.brightness,
        }
    }

    /// Density over area with which [`Emitters::sample`] gives points of a triangle; 0 for others.
    pub fn area_density(&self, instance: u32, triangle: u32) -> f32 {
        self.by_triangle.get(&(instance, triangle)).map_or(0.0, |&index| {
            self.choice.probability(index as usize) * 2.0 / self.triangles[index as usize].cross().length()
        })
    }
}

impl Emitter {
    /// Evaluates both sides in the middle and returns their sum times the area.
    fn measure(&mut self, scene: &Scene, materials: &PreparedMaterials, surface: &mut Surface) -> f32 {
        let cross = self.cross();
        let area = 0.5 * cross.length();
        if !(area > 0.0 && area.is_finite()) {
            return 0.0;
        }
        let normal = cross / (2.0 * area);
        let middle = self.corner + (self.edge_1 + self.edge_2) / 3.0;
        let [front, back] = [normal, -normal].map(|wo| {
            let hit = Hit::on(scene, [self.instance, self.triangle], [1.0 / 3.0; 2], 1.0);
            let point = materials.surface_point(scene, &hit, middle + wo, -wo, 0.0);
            materials.evaluate(scene, &point, surface);
            surface.emission().max_element()
        });
        self.brightness = front.max(back);
        (front + back) * area
    }
}

fn is_seen_by_all(instance: &Instance) -> bool {
    instance.visible_camera
        && instance.visible_diffuse
        && instance.visible_glossy
        && instance.visible_transmission
}

/// Whether a material can emit at all, judged by its nodes.
fn may_emit(material: &Material) -> bool {
    let is_zero = |input: &Input| match input {
        Input::Float(value) => *value == 0.0,
        Input::Rgb(color) => *color == [0.0; 3],
        Input::Link { .. } => false,
    };
    material.nodes.iter().any(|node| match node {
        Node::Emission { color, strength } => !is_zero(color) && !is_zero(strength),
        Node::Principled { emission_color, emission_strength, .. } => {
            !is_zero(emission_color) && !is_zero(emission_strength)
        }
        _ => false,
    })
}

/// Whether light can go straight through a material, judged by its nodes.
pub(crate) fn may_be_transparent(material: &Material) -> bool {
    material.nodes.iter().any(|node| match node {
        Node::Transparent { .. } => true,
        Node::Principled { alpha, .. } => *alpha != Input::Float(1.0),
        _ => false,
    })
}
