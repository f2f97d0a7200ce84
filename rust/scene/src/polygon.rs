//! Blender's polygon meshes to triangles, with the result of Blender's own tessellation.

use crate::damage::{can_be_met, sound_color, sound_uv};
use crate::{ColorAttribute, Displaceable, Mesh, UvMap};
use earcut::Earcut;
use glam::{Vec2, Vec3};

/// A polygon mesh as Blender stores it, object space, metres. Corners of a face are consecutive.
#[derive(Clone, Debug)]
pub struct PolygonMesh<'a> {
    /// Name for messages.
    pub name: &'a str,
    /// One a vertex.
    pub positions: &'a [Vec3],
    /// Vertex of each corner.
    pub corner_verts: &'a [i32],
    /// First corner of each face.
    pub face_starts: &'a [i32],
    /// Shading normals.
    pub normals: PolygonNormals<'a>,
    /// Faces that are flat although `normals` has values; empty if none.
    pub sharp_faces: &'a [bool],
    /// UV layers, one coordinate a corner, the active render one first.
    pub uv_maps: Vec<(String, &'a [Vec2])>,
    /// Colour attributes, scene-linear RGBA, one a corner, the active render one first.
    pub color_attributes: Vec<(String, &'a [[f32; 4]])>,
    /// Material slot of each face; empty if all are slot 0.
    pub material_slots: &'a [i32],
    /// Normals, one a vertex, if a material displaces it.
    pub displacement_normals: Option<&'a [Vec3]>,
    /// See [`Displaceable::turns_corner_normals`].
    pub turns_corner_normals: bool,
}

/// Shading normals of a polygon mesh, unit length.
#[derive(Clone, Copy, Debug)]
pub enum PolygonNormals<'a> {
    /// Every face is flat.
    Flat,
    /// One a vertex.
    Vertex(&'a [Vec3]),
    /// One a corner.
    Corner(&'a [Vec3]),
}

/// Why a polygon mesh was refused. Every message names the mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PolygonError {
    /// An array has the wrong number of elements.
    #[error(
        "mesh '{mesh}': {array} has {found} elements, expected {expected}; recalculate the mesh data in Blender"
    )]
    Length {
        /// Mesh name.
        mesh: String,
        /// Name of the array.
        array: String,
        /// Length of the array.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A face start or a vertex index points outside.
    #[error(
        "mesh '{mesh}': {array} {index} is {value}, outside 0..{limit}; run Mesh > Clean Up > Validate in Blender"
    )]
    Index {
        /// Mesh name.
        mesh: String,
        /// Name of the array.
        array: &'static str,
        /// Index of the element.
        index: usize,
        /// Value of the element.
        value: i64,
        /// First value not allowed.
        limit: usize,
    },
}

impl PolygonMesh<'_> {
    /// The triangles of the mesh. Triangles without area are left out: nothing can be seen of them. So are those with
    /// a corner in no finite place; of other numbers that are not finite [`PolygonMesh::damage`] tells what becomes.
    pub fn triangulate(&self) -> Result<Mesh, PolygonError> {
        self.check()?;
        let mut out = Mesh {
            name: self.name.into(),
            positions: self.positions.iter().map(|p| if can_be_met(*p) { *p } else { Vec3::ZERO }).collect(),
            uv_maps: self
                .uv_maps
                .iter()
                .map(|(name, _)| UvMap { name: name.clone(), coords: Vec::new() })
                .collect(),
            color_attributes: self
                .color_attributes
                .iter()
                .map(|(name, _)| ColorAttribute { name: name.clone(), colors: Vec::new() })
                .collect(),
            displaceable: self.displacement_normals.map(|normals| Displaceable {
                vertex_normals: normals.iter().map(|normal| normal.normalize_or_zero()).collect(),
                flat_triangles: Vec::new(),
                turns_corner_normals: self.turns_corner_normals,
            }),
            ..Mesh::default()
        };
        out.triangles.reserve(self.corner_verts.len().saturating_sub(2 * self.face_starts.len()));
        let mut polygon = Polygon::default();
        for face in 0..self.face_starts.len() {
            let corners = self.face_corners(face);
            let first = corners.start as u32;
            match corners.len() {
                0..=2 => {}
                3 => self.push_triangle(&mut out, face, [first, first + 1, first + 2]),
                4 => {
                    let flip = flips_diagonal(corners.map(|c| self.corner_position(c)));
                    let [a, b] = if flip { [[0, 1, 3], [1, 2, 3]] } else { [[0, 1, 2], [0, 2, 3]] };
                    self.push_triangle(&mut out, face, a.map(|i| first + i));
                    self.push_triangle(&mut out, face, b.map(|i| first + i));
                }
                _ if corners.clone().all(|c| can_be_met(self.corner_position(c))) => {
                    for triangle in polygon.triangulate(corners.map(|c| self.corner_position(c))) {
                        self.push_triangle(&mut out, face, triangle.map(|i| first + i));
                    }
                }
                _ => {}
            }
        }
        Ok(out)
    }

    fn push_triangle(&self, out: &mut Mesh, face: usize, corners: [u32; 3]) {
        let corners = corners.map(|c| c as usize);
        let [a, b, c] = corners.map(|c| self.corner_position(c));
        if ![a, b, c].into_iter().all(can_be_met) {
            return;
        }
        let area_normal = (b - a).as_dvec3().cross((c - a).as_dvec3());
        let Some(flat_normal) = area_normal.try_normalize() else { return };
        let flat = self.sharp_faces.get(face).is_some_and(|sharp| *sharp);
        let normal_of = |corner: usize| match self.normals {
            PolygonNormals::Vertex(normals) if !flat => normals[self.corner_verts[corner] as usize],
            PolygonNormals::Corner(normals) if !flat => normals[corner],
            _ => flat_normal.as_vec3(),
        };
        if !matches!(self.normals, PolygonNormals::Flat) {
            // Blender leaves zero normals where neighbouring faces cancel out, and others where one is damaged.
            let usable = |normal: Vec3| normal.try_normalize().unwrap_or(flat_normal.as_vec3());
            out.corner_normals.extend(corners.map(|corner| usable(normal_of(corner))));
        }
        if let Some(displaceable) = out.displaceable.as_mut().filter(|_| !self.sharp_faces.is_empty()) {
            displaceable.flat_triangles.push(flat);
        }
        out.triangles.push(corners.map(|c| self.corner_verts[c] as u32));
        for (map, (_, coords)) in out.uv_maps.iter_mut().zip(&self.uv_maps) {
            map.coords.extend(corners.map(|c| sound_uv(coords[c])));
        }
        for (attribute, (_, colors)) in out.color_attributes.iter_mut().zip(&self.color_attributes) {
            attribute.colors.extend(corners.map(|c| sound_color(colors[c])));
        }
        if let Some(slot) = self.material_slots.get(face) {
            out.material_slots.push((*slot).clamp(0, u16::MAX.into()) as u16);
        }
    }

    fn corner_position(&self, corner: usize) -> Vec3 {
        self.positions[self.corner_verts[corner] as usize]
    }

    /// Corners of a face.
    pub fn face_corners(&self, face: usize) -> std::ops::Range<usize> {
        let end = self.face_starts.get(face + 1).map_or(self.corner_verts.len(), |start| *start as usize);
        self.face_starts[face] as usize..end
    }

    /// Refuses arrays that do not belong together.
    pub fn check(&self) -> Result<(), PolygonError> {
        let (corners, faces) = (self.corner_verts.len(), self.face_starts.len());
        self.check_indices("corner vertex", self.corner_verts, self.positions.len())?;
        self.check_indices("face start", self.face_starts, corners + 1)?;
        let descending = (1..faces).find(|face| self.face_starts[*face] < self.face_starts[face - 1]);
        if let Some(index) = descending {
            let value = self.face_starts[index].into();
            return Err(PolygonError::Index {
                mesh: self.name.into(),
                array: "face start",
                index,
                value,
                limit: corners,
            });
        }
        match self.normals {
            PolygonNormals::Flat => {}
            PolygonNormals::Vertex(normals) => {
                self.check_length("vertex normals", normals.len(), self.positions.len())?;
            }
            PolygonNormals::Corner(normals) => {
                self.check_length("corner normals", normals.len(), corners)?;
            }
        }
        if let Some(normals) = self.displacement_normals {
            self.check_length("displacement normals", normals.len(), self.positions.len())?;
        }
        for (name, coords) in &self.uv_maps {
            self.check_length(&format!("UV map '{name}'"), coords.len(), corners)?;
        }
        for (name, colors) in &self.color_attributes {
            self.check_length(&format!("colour attribute '{name}'"), colors.len(), corners)?;
        }
        for (array, length) in
            [("material_index", self.material_slots.len()), ("sharp_face", self.sharp_faces.len())]
        {
            if length != 0 {
                self.check_length(array, length, faces)?;
            }
        }
        Ok(())
    }

    fn check_length(&self, array: &str, found: usize, expected: usize) -> Result<(), PolygonError> {
        if found == expected {
            return Ok(());
        }
        Err(PolygonError::Length { mesh: self.name.into(), array: array.into(), found, expected })
    }

    fn check_indices(&self, array: &'static str, values: &[i32], limit: usize) -> Result<(), PolygonError> {
        match values.iter().position(|value| usize::try_from(*value).map_or(true, |v| v >= limit)) {
            None => Ok(()),
            Some(index) => {
                let value = values[index].into();
                Err(PolygonError::Index { mesh: self.name.into(), array, index, value, limit })
            }
        }
    }
}

/// True if Blender splits a quad from its second to its fourth corner instead of from its first to its third: only
/// where the usual diagonal would run outside of a concave quad (`is_quad_flip_v3_first_third_fast` of Blender's
/// `math_geom`).
fn flips_diagonal(mut corners: impl Iterator<Item = Vec3>) -> bool {
    let mut next = || corners.next().unwrap_or_default();
    let [a, b, c, d] = [next(), next(), next(), next()];
    let diagonal = c - a;
    (b - a).cross(diagonal).dot((d - a).cross(diagonal)) > 0.0
}

/// Ear clipping of one n-gon, in the plane that its normal is closest to.
#[derive(Default)]
struct Polygon {
    points: Vec<Vec3>,
    projected: Vec<[f64; 2]>,
    earcut: Earcut<f64>,
    indices: Vec<u32>,
}

impl Polygon {
    /// Triangles of the polygon's corner numbers, wound as the polygon is.
    fn triangulate(&mut self, points: impl Iterator<Item = Vec3>) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.points.clear();
        self.points.extend(points);
        let (u, v) = newell_normal(&self.points).any_orthonormal_pair();
        self.projected.clear();
        self.projected.extend(self.points.iter().map(|p| [p.dot(u) as f64, p.dot(v) as f64]));
        self.indices.clear();
        self.earcut.earcut(self.projected.iter().copied(), &[], &mut self.indices);
        let projected = &self.projected;
        self.indices.chunks_exact(3).map(|t| {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| projected[i as usize]);
            let twice_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            if twice_area < 0.0 { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] }
        })
    }
}

/// Normal of a polygon that need not be flat; z if it has no area.
fn newell_normal(points: &[Vec3]) -> Vec3 {
    let pairs = points.iter().zip(points.iter().cycle().skip(1));
    let sum: glam::DVec3 =
        pairs.map(|(a, b)| (*a - points[0]).as_dvec3().cross((*b - points[0]).as_dvec3())).sum();
    sum.try_normalize().map_or(Vec3::Z, |n| n.as_vec3())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh<'a>(positions: &'a [Vec3], corners: &'a [i32], starts: &'a [i32]) -> PolygonMesh<'a> {
        PolygonMesh {
            name: "Test",
            positions,
            corner_verts: corners,
            face_starts: starts,
            normals: PolygonNormals::Flat,
            sharp_faces: &[],
            uv_maps: Vec::new(),
            color_attributes: Vec::new(),
            material_slots: &[],
            displacement_normals: None,
            turns_corner_normals: false,
        }
    }

    fn points(xy: &[[f32; 2]]) -> Vec<Vec3> {
        xy.iter().map(|p| Vec3::new(p[0], p[1], 0.0)).collect()
    }

    fn signed_areas(mesh: &Mesh) -> Vec<f32> {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            (b - a).cross(c - a).z / 2.0
        };
        mesh.triangles.iter().map(area).collect()
    }

    #[test]
    fn convex_quad_splits_from_first_to_third_corner() {
        let p = points(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        let mesh = mesh(&p, &[0, 1, 2, 3], &[0]).triangulate().unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn concave_quad_splits_inside() {
        // A dart whose second corner lies on the far side of the first diagonal.
        let p = points(&[[0.0, 0.0], [1.0, 0.9], [2.0, 2.0], [0.0, 2.0]]);
        let dart = points(&[[0.0, 0.0], [0.4, 1.0], [2.0, 2.0], [0.0, 2.0]]);
        for p in [p, dart] {
            let mesh = mesh(&p, &[0, 1, 2, 3], &[0]).triangulate().unwrap();
            assert!(signed_areas(&mesh).iter().all(|a| *a > 0.0), "{:?}", mesh.triangles);
        }
    }

    #[test]
    fn ngons_of_both_windings_keep_area_and_winding() {
        let star: Vec<[f32; 2]> = (0..10)
            .map(|i| {
                let (angle, r) = (i as f32 * 0.628_318_5, if i % 2 == 0 { 1.0 } else { 0.4 });
                [r * angle.cos(), r * angle.sin()]
            })
            .collect();
        let area = 0.5 * 10.0 * 0.4 * (0.628_318_5_f32).sin();
        let p = points(&star);
        let forward: Vec<i32> = (0..10).collect();
        let backward: Vec<i32> = (0..10).rev().collect();
        for (corners, sign) in [(forward, 1.0), (backward, -1.0)] {
            let areas = signed_areas(&mesh(&p, &corners, &[0]).triangulate().unwrap());
            assert_eq!(areas.len(), 8);
            assert!(areas.iter().all(|a| a * sign > 0.0), "{areas:?}");
            assert!((areas.iter().sum::<f32>() * sign - area).abs() < 1e-5);
        }
    }

    #[test]
    fn faces_of_all_sizes_keep_their_attributes() {
        let p = points(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.5], [0.0, 1.0]]);
        let uv: Vec<Vec2> = (0..9).map(|i| Vec2::new(i as f32, 0.5)).collect();
        let normals = [Vec3::Z, Vec3::X, Vec3::Z, Vec3::ZERO, Vec3::Z, Vec3::Z];
        let polygons = PolygonMesh {
            normals: PolygonNormals::Vertex(&normals),
            sharp_faces: &[false, true],
            uv_maps: vec![("UVMap".into(), &uv)],
            material_slots: &[3, 7],
            ..mesh(&p, &[0, 1, 5, 0, 1, 2, 3, 4, 5], &[0, 3])
        };
        let mesh = polygons.triangulate().unwrap();
        assert_eq!(mesh.triangles[0], [0, 1, 5]);
        assert_eq!(mesh.material_slots[0], 3);
        assert!(mesh.material_slots[1..].iter().all(|slot| *slot == 7));
        assert_eq!(mesh.corner_normals[..3], [Vec3::Z, Vec3::X, Vec3::Z]);
        assert!(mesh.corner_normals[3..].iter().all(|n| *n == Vec3::Z), "sharp faces are flat");
        for (corner, uv) in mesh.uv_maps[0].coords.iter().enumerate().skip(3) {
            let vertex = mesh.triangles[corner / 3][corner % 3];
            assert_eq!(polygons.corner_verts[uv.x as usize] as u32, vertex);
        }
    }

    #[test]
    fn zero_area_triangles_are_left_out() {
        let p = points(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]);
        let mesh = mesh(&p, &[0, 1, 2, 0, 1, 3], &[0, 3]).triangulate().unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 3]]);
    }

    #[test]
    fn damage_is_refused_by_name() {
        let p = points(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
        let message = |m: &PolygonMesh| m.triangulate().unwrap_err().to_string();
        assert!(message(&mesh(&p, &[0, 1, 3], &[0])).contains("'Test': corner vertex 2 is 3"));
        assert!(message(&mesh(&p, &[0, -1, 2], &[0])).contains("corner vertex 1 is -1"));
        assert!(message(&mesh(&p, &[0, 1, 2], &[0, 9])).contains("face start 1 is 9"));
        assert!(message(&mesh(&p, &[0, 1, 2], &[2, 0])).contains("face start 1"));
        let slots = PolygonMesh { material_slots: &[0, 1], ..mesh(&p, &[0, 1, 2], &[0]) };
        assert!(message(&slots).contains("material_index has 2 elements, expected 1"));
    }

    #[test]
    fn triangles_in_no_finite_place_are_left_out_and_other_numbers_replaced() {
        for bad in [f32::NAN, f32::INFINITY, 1e30] {
            let mut p = points(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
            p[1].z = bad;
            let quad = mesh(&p, &[0, 1, 2, 3], &[0]);
            assert!(quad.damage()[0].starts_with("1 of its vertices"), "{:?}", quad.damage());
            let out = quad.triangulate().unwrap();
            assert_eq!(out.triangles, [[0, 2, 3]]);
            assert!(out.positions.iter().all(|p| p.is_finite()));
            let ngon = points(&[[0.0, 0.0], [1.0, 0.0], [2.0, bad], [1.0, 1.0], [0.0, 1.0]]);
            assert!(mesh(&ngon, &[0, 1, 2, 3, 4], &[0]).triangulate().unwrap().triangles.is_empty());
        }
        let p = points(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
        let (normals, uv) =
            ([Vec3::NAN, Vec3::X, Vec3::Z], [Vec2::new(f32::NAN, 0.5), Vec2::ONE, Vec2::ZERO]);
        let damaged = PolygonMesh {
            normals: PolygonNormals::Corner(&normals),
            uv_maps: vec![("UVMap".into(), &uv)],
            color_attributes: vec![("Tint".into(), &[[f32::INFINITY, 0.5, 0.5, 1.0]; 3])],
            ..mesh(&p, &[0, 1, 2], &[0])
        };
        let words = damaged.damage().join("\n");
        for part in ["1 of its normals", "1 values of its UV map 'UVMap'", "3 values of its attribute 'Tint'"]
        {
            assert!(words.contains(part), "{words}");
        }
        let out = damaged.triangulate().unwrap();
        assert_eq!(out.corner_normals, [Vec3::Z, Vec3::X, Vec3::Z]);
        assert_eq!(out.uv_maps[0].coords[0], Vec2::new(0.0, 0.5));
        assert_eq!(out.color_attributes[0].colors[0], [0.0, 0.5, 0.5, 1.0]);
    }
}
