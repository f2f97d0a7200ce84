//! Attributes and normals of diced faces.

use glam::{Vec2, Vec3, Vec4};
use relume_scene::{ColorAttribute, Displaceable, Mesh, PolygonMesh, PolygonNormals};

use super::Patches;
use super::dicer::Diced;

/// Bilinear interpolation between values at the corners of the face that a patch belongs to: its own corner, the middles
/// of both edges there, and the mean of all.
pub(super) struct CornerBlend<'a> {
    patches: &'a Patches,
    /// First corner of the face.
    first: usize,
    count: usize,
    /// Corner of the patch in its face.
    own: usize,
}

/// Values that can be blended.
pub(super) trait Blend:
    Copy + std::ops::Add<Output = Self> + std::ops::Mul<f32, Output = Self>
{
}

impl<T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>> Blend for T {}

impl<'a> CornerBlend<'a> {
    pub fn new(patches: &'a Patches, patch: u32) -> Self {
        let face = patches.diced_faces[patch as usize] as usize;
        let (first, end) = (patches.starts[face] as usize, patches.starts[face + 1] as usize);
        Self { patches, first, count: end - first, own: patch as usize - first }
    }

    /// Value at a place of the patch; `value` takes corners of the polygon mesh.
    pub fn at<T: Blend>(&self, place: Vec2, value: impl Fn(usize) -> T) -> T {
        let corner = |number: usize| value(self.patches.sources[self.first + number % self.count] as usize);
        let share = 1.0 / self.count as f32;
        let mut mean = corner(0) * share;
        for number in 1..self.count {
            mean = mean + corner(number) * share;
        }
        let own = corner(self.own);
        let [after, before] =
            [self.own + 1, self.own + self.count - 1].map(|number| (own + corner(number)) * 0.5);
        let Vec2 { x, y } = place;
        (own * (1.0 - x) + after * x) * (1.0 - y) + (before * (1.0 - x) + mean * x) * y
    }
}

/// Adds the colour attributes of a polygon mesh to its diced form.
pub(super) fn add_colors(mesh: &mut Mesh, polygons: &PolygonMesh<'_>, patches: &Patches, diced: &Diced) {
    for (name, colors) in &polygons.color_attributes {
        let color = |corner: usize| {
            let color = Vec4::from(colors[corner]);
            Vec4::select(color.is_finite_mask(), color, Vec4::ZERO)
        };
        let at = |patch, place| CornerBlend::new(patches, patch).at(place, color).to_array();
        let colors = diced.per_corner(at);
        mesh.color_attributes.push(ColorAttribute { name: name.clone(), colors });
    }
}

/// Adds normals, and what displacement needs: those of the limit surface of smooth ones, else interpolated ones.
pub(super) fn add_normals(
    mesh: &mut Mesh,
    polygons: &PolygonMesh<'_>,
    patches: &Patches,
    diced: &Diced,
    is_smooth: bool,
) {
    let blended = |patch: u32, place: Vec2, normal: &dyn Fn(usize) -> Vec3| {
        CornerBlend::new(patches, patch).at(place, normal).normalize_or_zero()
    };
    let of_vertices = |normals: &[Vec3], corner: usize| normals[polygons.corner_verts[corner] as usize];
    let is_flat = |patch: u32| {
        let face = patches.faces[patch as usize] as usize;
        polygons.sharp_faces.get(face).is_some_and(|sharp| *sharp)
    };
    if let Some(normals) = polygons.displacement_normals {
        let vertex_normals = if is_smooth {
            diced.normals.clone()
        } else {
            let origins = diced.origins.iter();
            origins
                .map(|(patch, place)| blended(*patch, *place, &|corner| of_vertices(normals, corner)))
                .collect()
        };
        let flat_triangles = if polygons.sharp_faces.is_empty() {
            Vec::new()
        } else {
            diced.triangles.iter().map(|triangle| is_flat(triangle.patch)).collect()
        };
        mesh.displaceable = Some(Displaceable {
            vertex_normals,
            flat_triangles,
            turns_corner_normals: polygons.turns_corner_normals && !is_smooth,
        });
    }
    if matches!(polygons.normals, PolygonNormals::Flat) && !is_smooth {
        return;
    }
    for triangle in &diced.triangles {
        let corners = triangle.corners.map(|vertex| diced.positions[vertex as usize]);
        let [a, b, c] = corners;
        let flat = (b - a).cross(c - a).normalize_or(Vec3::Z);
        for (vertex, place) in triangle.corners.into_iter().zip(triangle.places) {
            let normal = match polygons.normals {
                _ if is_flat(triangle.patch) => flat,
                _ if is_smooth => diced.normals[vertex as usize],
                PolygonNormals::Vertex(normals) => {
                    blended(triangle.patch, place, &|corner| of_vertices(normals, corner))
                }
                PolygonNormals::Corner(normals) => blended(triangle.patch, place, &|corner| normals[corner]),
                PolygonNormals::Flat => flat,
            };
            mesh.corner_normals.push(normal.try_normalize().unwrap_or(flat));
        }
    }
}
