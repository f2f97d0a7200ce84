//! A photometric file of any text is refused, or gives finite strengths.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_scene::glam::Vec3;
use relume_scene::{IesBorder, IesProfile, IesSource};

fuzz_target!(|text: &str| {
    for border in [IesBorder::Zero, IesBorder::Nearest] {
        let profile = IesProfile::from(IesSource { text: text.to_owned(), border });
        for direction in
            [Vec3::NEG_Z, Vec3::new(0.3, -0.2, -0.5), Vec3::new(-1.0, 1.0, 0.1), Vec3::Z, Vec3::ZERO]
        {
            let strength = profile.strength(direction);
            assert!(strength >= 0.0 && strength.is_finite(), "{strength} towards {direction}");
        }
    }
});
