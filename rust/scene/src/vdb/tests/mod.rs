use super::*;
use crate::grid::{BRICK, Grid};
use glam::{Affine3A, IVec3, Mat3A, Vec3, Vec3A};
use writer::{ACTIVE_MASK, BLOSC, Numbers, TestGrid, ZIP, file, scale};

mod writer;

/// In two nodes of one child of the root, and in two other children.
const BRICKS: [[i32; 3]; 4] = [[0, 0, 0], [2, 17, 0], [-1, 2, 3], [15, 0, -10]];

/// Whole numbers that halves hold exactly.
fn ramp(voxel: IVec3) -> [f32; 3] {
    let sum = (voxel.x * 3 + voxel.y * 5 - voxel.z * 7) as f32;
    [sum, 2.0 * sum + 1.0, -sum]
}

/// Every third voxel has a value.
fn thinned(voxel: IVec3) -> Option<[f32; 3]> {
    (voxel.element_sum().rem_euclid(3) == 0).then(|| ramp(voxel))
}

fn ball(compression: u32) -> TestGrid {
    let grid = TestGrid { compression, ..TestGrid::new("density") };
    BRICKS.into_iter().fold(grid, |grid, brick| grid.with_leaf(brick, thinned))
}

fn read(grid: &TestGrid) -> Result<Grid, String> {
    let bytes = file(225, std::slice::from_ref(grid));
    VdbFile::parse(&bytes)?.grid("density", f32::NEG_INFINITY)
}

/// Compares the voxels of a brick with a function, in the channels that there are.
fn assert_brick(grid: &Grid, brick: [i32; 3], value: impl Fn(IVec3) -> [f32; 3]) {
    let corner = IVec3::from_array(brick) * BRICK as i32;
    for place in 0..512 {
        let voxel = corner + IVec3::new(place >> 6, place >> 3 & 7, place & 7);
        let found = grid.value(voxel.as_vec3(), Default::default()).to_array();
        assert_eq!(found[..grid.channels.min(3)], value(voxel)[..grid.channels], "{voxel}");
    }
}

#[test]
fn every_packing_gives_the_same_voxels() {
    for compression in [0, ACTIVE_MASK, ZIP, ZIP | ACTIVE_MASK, BLOSC, BLOSC | ACTIVE_MASK] {
        for is_half in [false, true] {
            let written = TestGrid { is_half, ..ball(compression) };
            let grid = read(&written).unwrap();
            for brick in BRICKS {
                assert_brick(&grid, brick, |voxel| thinned(voxel).unwrap_or_default());
            }
            let [low, high] = grid.active.unwrap();
            assert_eq!((low, high), (IVec3::new(-8, 0, -80), IVec3::new(127, 143, 31)));
        }
    }
}

#[test]
fn every_type_of_numbers_is_read() {
    let types = [
        ("Tree_half_5_4_3", Numbers::Half, 1),
        ("Tree_double_5_4_3", Numbers::Double, 1),
        ("Tree_int32_5_4_3", Numbers::Int32, 1),
        ("Tree_vec3s_5_4_3", Numbers::Float, 3),
        ("Tree_vec3d_5_4_3", Numbers::Double, 3),
        ("Tree_vec3i_5_4_3", Numbers::Int32, 3),
    ];
    for (tree_type, numbers, channels) in types {
        let grid = TestGrid { tree_type, numbers, channels, ..ball(BLOSC | ACTIVE_MASK) };
        let grid = read(&grid).unwrap();
        assert_eq!(grid.channels, channels);
        assert_brick(&grid, [-1, 2, 3], |voxel| thinned(voxel).unwrap_or_default());
    }
    let halved =
        TestGrid { tree_type: "Tree_vec3s_5_4_3", channels: 3, is_half: true, ..ball(ZIP | ACTIVE_MASK) };
    assert_brick(&read(&halved).unwrap(), [15, 0, -10], |voxel| thinned(voxel).unwrap_or_default());
}

/// Inactive voxels of a level set have the background outside, its negative inside, or anything.
#[test]
fn inactive_values_are_restored() {
    for others in [
        vec![4.0],
        vec![-4.0],
        vec![7.0],
        vec![4.0, -4.0],
        vec![4.0, 7.0],
        vec![8.0, 7.0],
        vec![1.0, 2.0, 3.0],
    ] {
        let value = |voxel: IVec3| match voxel.x.rem_euclid(4) {
            0 => ([0.5; 3], true),
            step => ([others[(step as usize - 1) % others.len()]; 3], false),
        };
        let leaf = (0..512).map(|place| value(IVec3::new(place >> 6, 0, 0))).collect();
        let mut written = TestGrid { background: 4.0, ..TestGrid::new("density") };
        written.leaves.insert([0, 0, 0], leaf);
        let grid = read(&written).unwrap();
        assert_brick(&grid, [0, 0, 0], |voxel| value(voxel).0);
        assert_brick(&grid, [5, 0, 0], |_| [4.0; 3]);
    }
}

#[test]
fn tiles_fill_their_cubes_and_share_memory() {
    let mut written =
        TestGrid { background: 0.25, ..TestGrid::new("density") }.with_leaf([1, 1, 1], |_| Some([3.0; 3]));
    written.small_tiles.insert([2, 1, 1], (5.0, true));
    written.small_tiles.insert([3, 1, 1], (6.0, false));
    written.large_tiles.insert([16, 0, 0], (5.0, true));
    let grid = read(&written).unwrap();
    assert_brick(&grid, [1, 1, 1], |_| [3.0; 3]);
    assert_brick(&grid, [3, 1, 1], |_| [6.0; 3]);
    for brick in [[2, 1, 1], [16, 0, 0], [31, 15, 15], [20, 7, 3]] {
        assert_brick(&grid, brick, |_| [5.0; 3]);
    }
    for brick in [[0, 0, 0], [32, 0, 0], [31, 15, 16], [-1, 1, 1]] {
        assert_brick(&grid, brick, |_| [0.25; 3]);
    }
    assert_eq!(grid.active, Some([IVec3::new(8, 0, 0), IVec3::new(255, 127, 127)]));
    // Background, the leaf, and the two values of three tiles.
    assert_eq!(grid.values.len(), 4 * 512);
}

#[test]
fn transforms_of_every_kind_are_read() {
    let place = |map, map_numbers: Vec<f64>| {
        read(&TestGrid { map, map_numbers, ..ball(0) }).unwrap().object_from_index
    };
    let half = Affine3A::from_scale(Vec3::splat(0.5));
    assert_eq!(place("UniformScaleMap", scale([0.5; 3])), half);
    let stretched = Affine3A::from_scale(Vec3::new(0.5, 2.0, 1.0));
    assert_eq!(place("ScaleMap", scale([0.5, 2.0, 1.0])), stretched);
    let moved = Affine3A::from_translation(Vec3::new(1.0, 2.0, 3.0));
    let numbers = [vec![1.0, 2.0, 3.0], scale([0.5, 2.0, 1.0])].concat();
    assert_eq!(place("ScaleTranslateMap", numbers), moved * stretched);
    let numbers = [vec![1.0, 2.0, 3.0], scale([0.5; 3])].concat();
    assert_eq!(place("UniformScaleTranslateMap", numbers), moved * half);
    assert_eq!(place("TranslationMap", vec![1.0, 2.0, 3.0]), moved);
    let rows = vec![0.0, 2.0, 0.0, 0.0, -1.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 2.0, 3.0, 1.0];
    let axes = Mat3A::from_cols(Vec3A::new(0.0, 2.0, 0.0), Vec3A::new(-1.0, 0.0, 0.5), Vec3A::Z);
    let sheared = Affine3A { matrix3: axes, translation: Vec3A::new(1.0, 2.0, 3.0) };
    assert_eq!(place("AffineMap", rows), sheared);
}

#[test]
fn instances_share_a_tree_and_keep_their_transforms() {
    let other = TestGrid {
        unique_name: "heat\x1e1".into(),
        instance_of: "density",
        map_numbers: scale([3.0; 3]),
        ..TestGrid::new("")
    };
    let bytes = file(224, &[ball(BLOSC | ACTIVE_MASK), other]);
    let vdb = VdbFile::parse(&bytes).unwrap();
    assert_eq!(vdb.names().collect::<Vec<_>>(), ["density", "heat"]);
    let (density, heat) = (vdb.grid("density", 0.0).unwrap(), vdb.grid("heat", 0.0).unwrap());
    assert_eq!((&density.values, &density.slots), (&heat.values, &heat.slots));
    assert_eq!(heat.object_from_index, Affine3A::from_scale(Vec3::splat(3.0)));
}

#[test]
fn clipped_voxels_are_background_and_no_part_of_the_volume() {
    let mut written = TestGrid::new("density").with_leaf([0, 0, 0], |voxel| Some([0.1 * voxel.x as f32; 3]));
    written.small_tiles.insert([4, 0, 0], (0.3, true));
    let bytes = file(225, &[written]);
    let grid = VdbFile::parse(&bytes).unwrap().grid("density", 0.35).unwrap();
    assert_brick(&grid, [0, 0, 0], |voxel| [if voxel.x > 3 { 0.1 * voxel.x as f32 } else { 0.0 }; 3]);
    assert_brick(&grid, [4, 0, 0], |_| [0.0; 3]);
    assert_eq!(grid.active, Some([IVec3::new(4, 0, 0), IVec3::new(7, 7, 7)]));
}

#[test]
fn what_cannot_be_read_is_named() {
    let reason = |grid: TestGrid| read(&grid).unwrap_err();
    let points = reason(TestGrid { tree_type: "Tree_ptdataidx32_ptdata_5_4_3", ..ball(0) });
    assert!(points.contains("grid 'density'") && points.contains("'ptdataidx32'"), "{points}");
    assert!(
        reason(TestGrid { tree_type: "Tree_bool_5_4_3", ..ball(0) }).contains("'bool' are not supported")
    );
    assert!(reason(TestGrid { map: "NonlinearFrustumMap", ..ball(0) }).contains("frustum"));
    assert!(reason(TestGrid { map_numbers: scale([0.0; 3]), ..ball(0) }).contains("flat"));
    assert!(reason(TestGrid { instance_of: "nothing", ..ball(0) }).contains("not there"));
    let parse = |bytes: &[u8]| VdbFile::parse(bytes).map(|_| ()).unwrap_err();
    assert!(parse(b"smoke").contains("no OpenVDB file"));
    assert!(parse(&file(226, &[ball(0)])).contains("version 226"));
    assert!(parse(&file(221, &[ball(0)])).contains("version 221"));
    let bytes = file(225, &[ball(0)]);
    assert!(VdbFile::parse(&bytes).unwrap().grid("flame", 0.0).unwrap_err().contains("no grid 'flame'"));
    let mut zstandard = writer::blosc(&[1; 4096]);
    zstandard[2] = 0x1 | 4 << 5;
    assert!(super::blosc::decode(&zstandard, &mut [0; 4096]).unwrap_err().contains("Zstandard"));
}

#[test]
fn huge_grids_are_refused_before_they_take_memory() {
    let far =
        ball(0).with_leaf([100_000, 0, 0], |_| Some([1.0; 3])).with_leaf([0, 100_000, 9], |_| Some([1.0; 3]));
    assert!(read(&far).unwrap_err().contains("spans 800"), "{}", read(&far).unwrap_err());
    let root_tiles = vec![([0, 0, 0], 1.0, true)];
    assert!(read(&TestGrid { root_tiles, ..ball(0) }).unwrap_err().contains("crop it"));
    let unaligned = vec![([8, 0, 0], 1.0, true)];
    assert!(
        read(&TestGrid { root_tiles: unaligned, ..ball(0) }).unwrap_err().contains("lies where none can")
    );
}

/// Damage anywhere gives words, or a grid that is whole.
#[test]
fn damaged_files_are_refused_without_a_panic() {
    for compression in [ACTIVE_MASK, ZIP, BLOSC | ACTIVE_MASK] {
        let grid = TestGrid { compression, ..TestGrid::new("density") }.with_leaf([0, 0, 0], thinned);
        let bytes = file(225, &[grid]);
        let try_all = |bytes: &[u8]| {
            let Ok(vdb) = VdbFile::parse(bytes) else { return };
            if let Ok(grid) = vdb.grid("density", 0.0) {
                assert_eq!((grid.slots.len(), grid.values.len() % 512), (grid.bricks.len(), 0));
            }
        };
        for length in (0..bytes.len()).filter(|length| length % 7 == 0 && (*length < 600 || length % 91 == 0))
        {
            let cut = VdbFile::parse(&bytes[..length]).and_then(|vdb| vdb.grid("density", 0.0));
            assert!(cut.is_err(), "{length} bytes");
        }
        for position in (0..bytes.len()).filter(|place| *place < 200 || place % 89 == 0) {
            let mut damaged = bytes.clone();
            damaged[position] ^= 1 << (position % 8);
            try_all(&damaged);
            damaged[position] = 0xff;
            try_all(&damaged);
        }
    }
}

/// `tests/data/volume.py` writes them.
#[test]
fn files_of_blender_hold_their_function() {
    let files: [(&[u8], f32); 2] = [
        (include_bytes!("../../../tests/data/volume_4_2.vdb"), 0.5),
        (include_bytes!("../../../tests/data/volume_5_3.vdb"), 0.0),
    ];
    for (bytes, shift) in files {
        let vdb = VdbFile::parse(bytes).unwrap();
        assert_eq!(vdb.names().collect::<Vec<_>>(), ["density"]);
        let grid = vdb.grid("density", 1e-3).unwrap();
        assert_eq!(grid.active, Some([IVec3::ZERO, IVec3::splat(11)]));
        let edge = 2.0 / 11.0;
        for voxel in [IVec3::ZERO, IVec3::new(11, 0, 5), IVec3::new(3, 9, 8), IVec3::splat(11)] {
            let place = voxel.as_vec3() * edge - 1.0;
            let found = grid.value(voxel.as_vec3(), Default::default()).x;
            assert!((found - 7.0 - place.dot(Vec3::new(1.0, 2.0, 3.0))).abs() < 1e-5, "{voxel}: {found}");
            // Before Blender 5.0, a value is shown half a voxel above its place.
            let turned = glam::Quat::from_rotation_z(0.5) * (place - shift * edge) + Vec3::new(1.0, 2.0, 3.0);
            let placed = grid.object_from_index.transform_point3(voxel.as_vec3());
            assert!((placed - turned).abs().max_element() < 1e-5, "{voxel}: {placed}");
        }
    }
}
