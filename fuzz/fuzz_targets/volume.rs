//! An OpenVDB file of any bytes is refused, or its grids are whole and can be looked up.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_scene::glam::{Affine3A, Vec3};
use relume_scene::{Camera, GridInterpolation, GridSet, Instance, SceneBuilder, VdbFile};

fuzz_target!(|bytes: &[u8]| {
    let Ok(file) = VdbFile::parse(bytes) else { return };
    let names: Vec<String> = file.names().take(4).map(str::to_owned).collect();
    let Ok((set, _)) = GridSet::from_vdb("fuzzed", bytes, &names, 1e-3, GridInterpolation::Linear) else {
        return;
    };
    let mut builder = SceneBuilder::default();
    let Ok(Some((grids, mesh))) = builder.add_grids(set) else { return };
    let instance =
        Instance { grids: Some(grids), ..Instance::new("fuzzed", mesh, Affine3A::IDENTITY, vec![]) };
    builder.add_instance(instance).expect("its parts are there");
    builder.set_camera(Camera::default());
    let Ok(scene) = builder.build() else { return };
    for grid in &scene.grids[grids].grids {
        for position in [Vec3::ZERO, Vec3::splat(1e9), Vec3::NAN, Vec3::splat(-0.5)] {
            assert!(grid.value(position, GridInterpolation::Cubic).is_finite());
        }
        if grid.bricks.counts.element_product() < 1000 {
            assert!(grid.bounds().ranges.iter().flatten().all(|bound| bound.is_finite()));
        }
    }
});
