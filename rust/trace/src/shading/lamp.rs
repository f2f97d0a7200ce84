//! Emission of lamps whose shaders make it differ by direction or place, as tables.
//!
//! What a graph sees of a lamp is that of Cycles (`kernel/light` and `kernel/geom/shader_data.h` of Blender 4.2 to 5.3).
//! Where the lamp itself stands does not show: a graph that reads positions in the world has no such table.

use std::f32::consts::{PI, TAU};
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Affine3A, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use relume_dump::encode_rgb9e5;
use relume_scene::{
    EmissionMap, Falloff, Geometry, Instance, MapDomain, MapKey, Material, Mesh, Node, STILL, Scene, Texture,
    UvMap,
};

use super::{PreparedMaterials, RayInfo, SurfacePoint};
use crate::bsdf::Surface;

/// Angle of a spot's square cone, radians from the axis to a side, up to which a table of it is fine enough all over.
const WIDEST_CONE: f32 = 0.37 * PI;

/// A lamp as its shader sees it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lamp {
    /// Type of light.
    pub kind: LampKind,
    /// Quantity that the shader reads: one of the way back along the ray, a sphere's normal and an area's place.
    pub key: MapKey,
    /// Rows of the transform of directions, for a shader that reads some in world space; none if it does not matter.
    #[serde(default)]
    pub world_from_object: Option<[[f32; 3]; 3]>,
    /// Factor by distance.
    #[serde(default)]
    pub falloff: Falloff,
    /// Texels along each edge of the table.
    pub resolution: usize,
}

/// Type of lamp, by what its UV coordinates are.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(tag = "type", rename_all = "SCREAMING_SNAKE_CASE", deny_unknown_fields)]
pub enum LampKind {
    /// Longitude and latitude.
    Point,
    /// Square around the cone.
    Spot {
        /// Full angle of the cone, radians.
        spot_size: f32,
    },
    /// Shares of the edges.
    Area {
        /// Edges in the lamp's space.
        size: [f32; 2],
    },
    /// Disk in the sky.
    Sun {
        /// Full angle of the disk, radians.
        angle: f32,
        /// Lengths of its object's x and y axes, by which Cycles shrinks the picture on the disk.
        scale: [f32; 2],
    },
}

/// The largest value of a lamp's emission and the table of its shares of that; none if it emits nothing. Emission below zero
/// counts as none. Notes say in words what of the shader is not as it should be.
pub fn emission_map(
    material: &Material,
    textures: &[Texture],
    lamp: &Lamp,
) -> (Option<(f32, EmissionMap)>, Vec<String>) {
    let matrix =
        lamp.world_from_object.map_or(Mat3::IDENTITY, |rows| Mat3::from_cols_array_2d(&rows).transpose());
    let scene = stage(material, textures, matrix);
    let (prepared, mut notes) = PreparedMaterials::new(&scene);
    notes.extend(material.nodes.iter().filter_map(|node| {
        match node {
            Node::Ies { profile, .. } => profile
                .fault()
                .map(|fault| format!("{fault}; as in Cycles, it shines at a strength of 100 everywhere")),
            _ => None,
        }
    }));
    let domain = MapDomain { key: lamp.key, cone: lamp.kind.cone() };
    let width = lamp.resolution.clamp(1, 1 << 9);
    let (is_finite, is_positive) = (AtomicBool::new(true), AtomicBool::new(true));
    let mut values = vec![Vec3::ZERO; width * width];
    values.par_chunks_mut(width).enumerate().for_each(|(row, values)| {
        let mut surface = Surface::default();
        for (column, value) in values.iter_mut().enumerate() {
            let middle = |index: usize| (index as f32 + 0.5) / width as f32;
            let point = lamp.point(domain, matrix, [middle(column), middle(row)]);
            prepared.evaluate(&scene, &point, &mut surface);
            let emission = surface.emission();
            if emission.is_finite() {
                *value = emission.max(Vec3::ZERO);
                if emission.min_element() < 0.0 {
                    is_positive.store(false, Ordering::Relaxed);
                }
            } else {
                is_finite.store(false, Ordering::Relaxed);
            }
        }
    });
    if !is_finite.into_inner() {
        notes.push("its nodes emit what is no finite number; taken for black there".to_owned());
    }
    if !is_positive.into_inner() {
        notes.push("its nodes emit less than nothing in some directions; taken for black there".to_owned());
    }
    let largest = values.iter().map(|value| value.max_element()).fold(0.0, f32::max);
    if largest == 0.0 {
        return (None, notes);
    }
    let texels = values.iter().map(|&value| encode_rgb9e5(value / largest, Vec3::splat(0.5))).collect();
    (Some((largest, narrowed(EmissionMap { domain, width, texels, falloff: lamp.falloff }))), notes)
}

/// The table with one column if all are alike, as about the axis of most photometric files.
fn narrowed(map: EmissionMap) -> EmissionMap {
    let is_even = map.texels.chunks_exact(map.width).all(|row| row.iter().all(|&texel| texel == row[0]));
    if !is_even {
        return map;
    }
    let texels = map.texels.iter().step_by(map.width).copied().collect();
    EmissionMap { width: 1, texels, ..map }
}

/// A scene of one triangle whose UV coordinates are the weights of its corners.
fn stage(material: &Material, textures: &[Texture], matrix: Mat3) -> Scene {
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        triangles: vec![[0, 1, 2]],
        uv_maps: vec![UvMap { name: String::new(), coords: vec![Vec2::ZERO, Vec2::X, Vec2::Y] }],
        ..Mesh::default()
    };
    Scene {
        meshes: vec![mesh],
        instances: vec![Instance::new(&material.name, 0, Affine3A::from_mat3(matrix), vec![0])],
        materials: vec![material.clone()],
        textures: textures.to_vec(),
        ..Scene::default()
    }
}

impl LampKind {
    /// Cone of the table's directions.
    fn cone(&self) -> Option<f32> {
        match *self {
            Self::Spot { spot_size } if 0.5 * spot_size <= WIDEST_CONE => {
                Some((0.5 * spot_size).tan().max(1e-4))
            }
            Self::Sun { angle, .. } if 0.5 * angle <= WIDEST_CONE => Some((0.5 * angle).tan().max(1e-4)),
            _ => None,
        }
    }

    /// UV coordinates of a unit direction in the lamp's space.
    fn uv(&self, direction: Vec3) -> [f32; 2] {
        match *self {
            Self::Point => {
                let around = 0.5 - direction.x.atan2(direction.y) / TAU;
                [around, 1.0 - direction.z.clamp(-1.0, 1.0).acos() / PI]
            }
            Self::Spot { spot_size } => {
                let scale = -0.5 / ((0.5 * spot_size).tan() * direction.z);
                [direction.x * scale + 0.5, direction.y * scale + 0.5]
            }
            // Of an area, the way back says nothing of the place.
            Self::Area { .. } => [0.5; 2],
            Self::Sun { angle, scale: [scale_x, scale_y] } => {
                // The disk's radius is the sine of half of an angle over that of its edge (`kernel/light/sun.h`).
                let cos_half = (0.5 - 0.5 * direction.z).max(0.0).sqrt();
                let radius = -0.25 / ((0.25 * angle).sin() * cos_half);
                [direction.x * radius / scale_x + 0.5, direction.y * radius / scale_y + 0.5]
            }
        }
    }
}

impl Lamp {
    /// Point of the lamp that a place of its table is about, in the space of the scene around its origin.
    fn point(&self, domain: MapDomain, matrix: Mat3, place: [f32; 2]) -> SurfacePoint {
        let [u, v] = place;
        let direction = match self.key {
            MapKey::Place => Vec3::NEG_Z,
            MapKey::WayBack | MapKey::Normal => domain.direction(u, v).normalize(),
        };
        let in_world = |direction: Vec3| (matrix * direction).normalize_or(direction);
        let back = in_world(direction);
        let (normal, position) = match self.kind {
            LampKind::Area { size: [width, height] } => {
                let position = matrix * Vec3::new((u - 0.5) * width, (v - 0.5) * height, 0.0);
                (in_world(Vec3::NEG_Z), position)
            }
            LampKind::Point | LampKind::Spot { .. } | LampKind::Sun { .. } => (back, Vec3::ZERO),
        };
        SurfacePoint {
            position,
            geometric_normal: normal,
            shading_normal: normal,
            wo: back,
            backfacing: false,
            instance: 0,
            geometry: Geometry::Mesh(0),
            primitive: 0,
            barycentrics: if self.key == MapKey::Place { place } else { self.kind.uv(direction) },
            ray_length: 0.0,
            footprint: 0.0,
            strand: None,
            time: STILL,
            ray: RayInfo::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn map_of(nodes: Value, lamp: &Lamp) -> (Option<(f32, EmissionMap)>, Vec<String>) {
        let surface = nodes.as_array().map(|nodes| nodes.len() - 1);
        let material = json!({"name": "Lamp", "nodes": nodes, "surface": surface});
        emission_map(&serde_json::from_value(material).unwrap(), &[], lamp)
    }

    fn emitter(color: Value) -> Value {
        json!({"type": "emission", "color": color, "strength": 2.0})
    }

    fn at((largest, map): &(f32, EmissionMap), direction: Vec3) -> Vec3 {
        let [u, v] = map.domain.place(direction);
        let index = |share: f32, count: usize| ((share * count as f32) as usize).min(count - 1);
        let texel = map.texels[index(v, map.height()) * map.width + index(u, map.width)];
        *largest * relume_dump::decode_rgb9e5(texel)
    }

    const SPOT: Lamp = Lamp {
        kind: LampKind::Spot { spot_size: 1.2 },
        key: MapKey::WayBack,
        world_from_object: None,
        falloff: Falloff { power: 0.0, smooth: 0.0 },
        resolution: 256,
    };
    const POINT: Lamp = Lamp { kind: LampKind::Point, ..SPOT };

    #[test]
    fn normals_are_directions_in_the_lamps_space() {
        let nodes = json!([{"type": "texture_coordinate", "kind": "normal"}, emitter(json!({"node": 0, "output": "vector"}))]);
        let (map, notes) = map_of(nodes, &POINT);
        let map = map.unwrap();
        assert!(notes[0].contains("less than nothing"), "{notes:?}");
        for direction in [Vec3::new(0.6, 0.3, -0.7), Vec3::new(-0.6, 0.3, 0.7), Vec3::new(0.1, -0.9, 0.2)] {
            let wanted = 2.0 * direction.normalize().max(Vec3::ZERO);
            assert!((at(&map, direction) - wanted).abs().max_element() < 0.03, "{direction}");
        }
    }

    #[test]
    fn the_uv_square_of_a_spot_holds_its_cone() {
        let nodes = json!([{"type": "uv_map", "name": ""}, emitter(json!({"node": 0, "output": "vector"}))]);
        let map = map_of(nodes, &SPOT).0.unwrap();
        let edge = 0.6_f32.tan();
        for (x, y) in [(0.9, 0.0), (-0.5, 0.8), (0.3, -0.3)] {
            let wanted = Vec3::new(x + 1.0, y + 1.0, 0.0);
            let found = at(&map, Vec3::new(x * edge, y * edge, -1.0));
            assert!((found - wanted).abs().max_element() < 0.02, "{x} {y}: {found}");
        }
    }

    #[test]
    fn areas_see_their_place_and_suns_their_disk() {
        let nodes = json!([{"type": "uv_map", "name": ""}, emitter(json!({"node": 0, "output": "vector"}))]);
        let area = Lamp { kind: LampKind::Area { size: [3.0, 1.0] }, key: MapKey::Place, ..SPOT };
        let (largest, map) = map_of(nodes.clone(), &area).0.unwrap();
        let texel = |x: usize, y: usize| largest * relume_dump::decode_rgb9e5(map.texels[y * map.width + x]);
        assert!((texel(64, 192) - 2.0 * Vec3::new(0.25, 0.75, 0.0)).abs().max_element() < 0.02);
        let object = json!([{"type": "texture_coordinate", "kind": "object"}, emitter(json!({"node": 0, "output": "vector"}))]);
        let (largest, map) = map_of(object, &area).0.unwrap();
        let texel = |x: usize, y: usize| largest * relume_dump::decode_rgb9e5(map.texels[y * map.width + x]);
        assert!((texel(192, 192) - 2.0 * Vec3::new(0.75, 0.25, 0.0)).abs().max_element() < 0.02);

        let sun = Lamp { kind: LampKind::Sun { angle: 0.4, scale: [2.0, 1.0] }, ..SPOT };
        let map = map_of(nodes, &sun).0.unwrap();
        // Coordinates of the way to a sun, which stands at +z.
        for (to_sun, uv) in [((0.2_f32.sin(), 0.0), [0.75, 0.5]), ((0.0, -0.1_f32.sin()), [0.5, 0.25])] {
            let back = -Vec3::new(to_sun.0, to_sun.1, (1.0 - to_sun.0.powi(2) - to_sun.1.powi(2)).sqrt());
            let wanted = 2.0 * Vec3::new(uv[0], uv[1], 0.0);
            assert!((at(&map, back) - wanted).abs().max_element() < 0.02, "{to_sun:?}: {}", at(&map, back));
        }
    }

    #[test]
    fn what_is_even_about_the_axis_has_one_column() {
        let text = "x\nTILT=NONE\n1 1 1 3 1 1 2 0 0 0 1 1 1\n0 60 180\n0\n10 20 0\n";
        let ies = |text: &str| {
            json!([{"type": "ies", "profile": {"text": text, "border": "nearest"}, "strength": 1.0, "vector": null},
                   emitter(json!({"node": 0, "output": "value"}))])
        };
        let (map, notes) = map_of(ies(text), &POINT);
        let map = map.unwrap();
        assert_eq!((map.1.width, map.1.height(), notes.len()), (1, 256, 0));
        assert!((at(&map, Vec3::NEG_Z).x / (2.0 * 10.0 * 0.070_665_08) - 1.0).abs() < 0.01);
        let (_, notes) = map_of(ies("none"), &POINT);
        assert!(notes[0].contains("IES"), "{notes:?}");
        let (map, notes) = map_of(json!([emitter(json!([-1.0, 0.0, 0.0]))]), &POINT);
        assert!(map.is_none() && notes[0].contains("less than nothing"), "{notes:?}");
    }
}
