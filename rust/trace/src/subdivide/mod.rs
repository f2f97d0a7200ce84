//! Adaptive subdivision: faces are diced until their edges are as short as asked for, along the surface that their mesh
//! stands for, as Cycles does it (`subd/split.cpp`, `subd/dice.cpp`).

mod dicer;
mod interpolate;
mod keys;
mod screen;
mod surface;
#[cfg(test)]
mod tests;

use glam::{Vec2, Vec3};
use relume_scene::{Mesh, PolygonError, PolygonMesh, UvMap, can_be_met};

use dicer::{Diced, Dicer};
use interpolate::CornerBlend;
use keys::edge_key;
pub use screen::Screen;
pub use surface::Border;
use surface::{Creases, Scheme, Surface};

/// Edges of the surface are refined to this many times the length of diced edges. Between them it is bilinear: on a
/// sphere of 100 pixels that is wrong by 0.02 pixels.
const SURFACE_EDGE: f32 = 4.0;
/// Most triangles that adaptive subdivision makes of all meshes of a scene; they take some 4 GB while it is traced.
pub const MOST_TRIANGLES: usize = 16_000_000;
/// Factor on the length of edges where a mesh would have too many triangles.
const COARSER: f32 = 1.25;

/// How finely a mesh is diced.
#[derive(Clone, Debug)]
pub struct Dicing {
    /// Length of edges: in pixels where there is a screen, else in metres of the object.
    pub edge: f32,
    /// Most times that a face is halved along either side.
    pub levels: u8,
    /// Border of a Catmull-Clark surface and of its UV maps, which are bilinear without; nothing where faces are
    /// bilinear themselves.
    pub smooth: Option<(Border, Option<Border>)>,
    /// Camera that pixels are counted for.
    pub screen: Option<Screen>,
}

/// Mesh that stands for a surface.
#[derive(Clone, Debug)]
pub struct Cage<'a> {
    /// Its faces and attributes.
    pub polygons: &'a PolygonMesh<'a>,
    /// Vertices of edges that are not smooth, and their sharpness.
    pub creases: Vec<([u32; 2], f32)>,
    /// Sharpness of vertices; empty if all are smooth.
    pub sharp_vertices: &'a [f32],
    /// Positions at keys, as [`Mesh::motion`].
    pub motion: &'a [Vec3],
}

impl Cage<'_> {
    /// Dices the surface of the mesh, into `limit` triangles at most where it can be. Returns the mesh and the length of
    /// edges that was taken.
    pub fn diced(&self, dicing: &Dicing, limit: usize) -> Result<(Mesh, f32), PolygonError> {
        self.polygons.check()?;
        let mut dicing = dicing.clone();
        loop {
            let patches = Patches::new(self);
            // Not even coarse edges help a mesh that has as many faces.
            let limit = limit.max(4 * patches.faces.len());
            if let Some(mesh) = self.try_dice(&dicing, &patches, limit) {
                return Ok((mesh, dicing.edge));
            }
            dicing.edge *= COARSER;
        }
    }

    fn try_dice(&self, dicing: &Dicing, patches: &Patches, limit: usize) -> Option<Mesh> {
        let scheme = |border: Option<Border>| border.map_or(Scheme::Linear, Scheme::CatmullClark);
        let (border, uv_border) = dicing.smooth.unzip();
        let polygons = self.polygons;
        let sound = |positions: &[Vec3]| -> Vec<Vec3> {
            positions.iter().map(|point| if can_be_met(*point) { *point } else { Vec3::ZERO }).collect()
        };
        let shape = |positions: &[Vec3]| {
            let creases = self.creases_of(patches, &patches.corners);
            Surface::new(
                scheme(border),
                patches.starts.clone(),
                patches.corners.clone(),
                sound(positions),
                creases,
            )
        };
        let count = polygons.positions.len();
        let mut surfaces = vec![shape(polygons.positions)];
        let is_smooth_uv = uv_border.flatten().is_some();
        for (_, coords) in polygons.uv_maps.iter().filter(|_| is_smooth_uv) {
            let (corners, points) = patches.merged(coords);
            let creases = self.creases_of(patches, &corners);
            let starts = patches.starts.clone();
            surfaces.push(Surface::new(scheme(uv_border.flatten()), starts, corners, points, creases));
        }
        let first_key = surfaces.len();
        surfaces.extend(self.motion.chunks_exact(count.max(1)).map(shape));
        if border.is_some() {
            refine(&mut surfaces, dicing, limit)?;
        }
        let (surface, others) = surfaces.split_first()?;
        let diced = Dicer::new(surface, dicing, limit).dice()?;
        let (uv_surfaces, keys) = others.split_at(first_key - 1);
        Some(self.mesh(dicing, patches, &diced, uv_surfaces, keys))
    }

    /// The triangles with all that belongs to them.
    fn mesh(
        &self,
        dicing: &Dicing,
        patches: &Patches,
        diced: &Diced,
        uv_surfaces: &[Surface],
        keys: &[Surface],
    ) -> Mesh {
        let polygons = self.polygons;
        let mut mesh = Mesh {
            name: polygons.name.into(),
            positions: diced.positions.clone(),
            triangles: diced.triangles.iter().map(|triangle| triangle.corners).collect(),
            ..Mesh::default()
        };
        for key in keys {
            mesh.motion.extend(diced.origins.iter().map(|(patch, place)| key.point(*patch, *place)));
        }
        let blend = |patch: u32| CornerBlend::new(patches, patch);
        for (number, (name, coords)) in polygons.uv_maps.iter().enumerate() {
            let coords = match uv_surfaces.get(number) {
                Some(surface) => diced.per_corner(|patch, place| surface.point(patch, place).truncate()),
                None => diced.per_corner(|patch, place| {
                    blend(patch).at(place, |corner| {
                        if coords[corner].is_finite() { coords[corner] } else { Vec2::ZERO }
                    })
                }),
            };
            mesh.uv_maps.push(UvMap { name: name.clone(), coords });
        }
        interpolate::add_colors(&mut mesh, polygons, patches, diced);
        if !polygons.material_slots.is_empty() {
            let slot = |patch: u32| polygons.material_slots[patches.faces[patch as usize] as usize];
            let slots =
                diced.triangles.iter().map(|triangle| slot(triangle.patch).clamp(0, u16::MAX.into()) as u16);
            mesh.material_slots = slots.collect();
        }
        interpolate::add_normals(&mut mesh, polygons, patches, diced, dicing.smooth.is_some());
        mesh
    }

    /// Creases of a surface with other vertices at the same corners.
    fn creases_of(&self, patches: &Patches, corners: &[u32]) -> Creases {
        let mut found = Creases::default();
        if self.creases.is_empty() && self.sharp_vertices.is_empty() {
            return found;
        }
        let mut own = Creases::default();
        own.edges.extend(self.creases.iter().map(|([a, b], sharpness)| (edge_key(*a, *b), *sharpness)));
        for face in patches.starts.windows(2) {
            let range = face[0] as usize..face[1] as usize;
            for (number, corner) in range.clone().enumerate() {
                let after = range.start + (number + 1) % range.len();
                let vertex = patches.corners[corner];
                if let Some(sharpness) = own.edges.get(&edge_key(vertex, patches.corners[after])) {
                    found.edges.insert(edge_key(corners[corner], corners[after]), *sharpness);
                }
                let sharpness = self.sharp_vertices.get(vertex as usize).copied().unwrap_or(0.0);
                if sharpness > 0.0 {
                    found.vertices.insert(corners[corner].into(), sharpness);
                }
            }
        }
        found
    }
}

/// Refines surfaces that have the same faces until the edges of the first one are short. Nothing if that takes too many
/// points.
fn refine(surfaces: &mut [Surface], dicing: &Dicing, limit: usize) -> Option<()> {
    let longest = SURFACE_EDGE * dicing.edge;
    let mut faces: Vec<u32> = (0..surfaces[0].patch_count() as u32).collect();
    while surfaces[0].depth() < usize::from(dicing.levels) {
        let is_large = |face: &u32| {
            let corners = surfaces[0].deepest_corners(*face);
            (0..4).any(|side| dicing.length(corners[side], corners[(side + 1) % 4]) > longest)
        };
        faces.retain(is_large);
        if faces.is_empty() {
            break;
        }
        let chosen = surfaces[0].with_neighbours(&faces);
        surfaces.iter_mut().for_each(|surface| surface.refine(&faces, &chosen));
        if surfaces[0].point_count() > limit {
            return None;
        }
        let children = |face: &u32| (0..4).map(|number| surfaces[0].first_child(*face) + number).collect();
        faces = faces.iter().flat_map(|face| -> Vec<u32> { children(face) }).collect();
    }
    Some(())
}

impl Dicing {
    /// Length of the edge between two points of the object, in the unit of `edge`.
    fn length(&self, a: Vec3, b: Vec3) -> f32 {
        self.screen.as_ref().map_or_else(|| a.distance(b), |screen| screen.length(a, b))
    }
}

/// Faces that are diced, and the quads that they are made of: one at each corner.
struct Patches {
    /// First corner of each face, and their number.
    starts: Vec<u32>,
    /// Vertex of each corner.
    corners: Vec<u32>,
    /// Corner of the polygon mesh for each corner.
    sources: Vec<u32>,
    /// Face of the polygon mesh of each patch.
    faces: Vec<u32>,
    /// Face, among those that are diced, of each patch.
    diced_faces: Vec<u32>,
}

impl Patches {
    /// Leaves out what can be no face.
    fn new(cage: &Cage<'_>) -> Self {
        let polygons = cage.polygons;
        let mut found = Self {
            starts: vec![0],
            corners: Vec::new(),
            sources: Vec::new(),
            faces: Vec::new(),
            diced_faces: Vec::new(),
        };
        for face in 0..polygons.face_starts.len() {
            let range = polygons.face_corners(face);
            let mut vertices = polygons.corner_verts[range.clone()].iter().map(|vertex| *vertex as usize);
            if range.len() < 3 || vertices.any(|vertex| !can_be_met(polygons.positions[vertex])) {
                continue;
            }
            found.corners.extend(polygons.corner_verts[range.clone()].iter().map(|vertex| *vertex as u32));
            found.sources.extend(range.clone().map(|corner| corner as u32));
            let number = found.starts.len() as u32 - 1;
            found.faces.extend(range.clone().map(|_| face as u32));
            found.diced_faces.extend(range.map(|_| number));
            found.starts.push(found.corners.len() as u32);
        }
        found
    }

    /// Corners with the same vertex and coordinates as one: their numbers, and the coordinates.
    fn merged(&self, coords: &[Vec2]) -> (Vec<u32>, Vec<Vec3>) {
        let mut points: Vec<Vec3> = Vec::new();
        let mut known: std::collections::HashMap<u64, Vec<u32>, keys::BuildKeyHasher> = Default::default();
        let corners = self.corners.iter().zip(&self.sources).map(|(vertex, source)| {
            let coord = coords[*source as usize];
            let coord = if coord.is_finite() { coord.extend(0.0) } else { Vec3::ZERO };
            let here = known.entry(u64::from(*vertex)).or_default();
            here.iter().find(|number| points[**number as usize] == coord).copied().unwrap_or_else(|| {
                points.push(coord);
                here.push(points.len() as u32 - 1);
                here[here.len() - 1]
            })
        });
        let corners = corners.collect();
        (corners, points)
    }
}
