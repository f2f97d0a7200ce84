//! Damaged files of a bake are found by name, and stop nothing that can do without them.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{RAW, baked, sphere, trained};
use relume_session::image::{BitDepth, Image, ViewTransform};
use relume_session::proxy::LightKind;
use relume_session::{Method, Monitor, RelightOptions, Relighter, VIEW_FILE, validate};
use std::path::Path;

const DAMAGES: u64 = 60;

/// Numbers that look random, the same in each run (SplitMix64).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % limit as u64) as usize
    }
}

/// The bytes of a file with one damage of five kinds, and what that is.
fn damaged(good: &[u8], kind: u64, random: &mut Random) -> (Vec<u8>, &'static str) {
    let mut bytes = good.to_vec();
    let place = random.below(bytes.len());
    match kind {
        0 => {
            bytes[place] ^= 1 << random.below(8);
            (bytes, "a flipped bit")
        }
        1 => {
            bytes.truncate(place);
            (bytes, "a cut")
        }
        2 => {
            let end = (place + 32).min(bytes.len());
            bytes[place..end].iter_mut().for_each(|byte| *byte = !*byte ^ random.below(127) as u8);
            (bytes, "other bytes")
        }
        3 => (Vec::new(), "no bytes"),
        _ => (br#"{"format": "something", "version": 18446744073709551615}"#.to_vec(), "another JSON"),
    }
}

fn write_view_table(folder: &Path) {
    let table = Image { data: vec![0.5; 4 * 2 * 3], ..Image::new(4, 2, 3) };
    relume_session::image::write_png(
        &folder.join(VIEW_FILE),
        &table,
        &ViewTransform::Standard,
        BitDepth::Eight,
    )
    .unwrap();
}

/// Files that the add-on writes beside a bake, with checksums.
const SHOT: &str = r#"{"format": "relume-shot", "version": 1, "camera": "Camera", "receivers": ["Floor"], "prints": {"film": {"size": "20 x 16"}}, "maps": {}, "checksum": "7cfb4d28"}"#;
const WANTED: &str = r#"{"format": "relume-wanted", "version": 1, "samples": 64, "train_seconds": 60.0, "checksum": "b280f39d"}"#;

#[test]
fn random_damage_is_named_and_stops_nothing_that_can_do_without_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    baked(path);
    trained(path, path, LightKind::Sphere);
    write_view_table(path);
    std::fs::write(path.join("shot.json"), SHOT).unwrap();
    std::fs::write(path.join("wanted.json"), WANTED).unwrap();
    let monitor = Monitor::default();
    assert_eq!(validate(path, &monitor).unwrap(), [""; 0]);
    let mut names: Vec<String> = std::fs::read_dir(path)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    let light = [sphere("Key", 0.2)];
    let options = RelightOptions { method: Method::Gather, ..RAW };
    let relit = || Relighter::open(path).and_then(|found| found.relight(&light, &options, &monitor));
    let whole = relit().unwrap().combined();
    let mut random = Random(7);
    for number in 0..DAMAGES {
        let name = &names[number as usize % names.len()];
        let good = std::fs::read(path.join(name)).unwrap();
        let (bytes, damage) = damaged(&good, number / names.len() as u64 % 5, &mut random);
        std::fs::write(path.join(name), bytes).unwrap();
        let problems = validate(path, &monitor).unwrap();
        assert!(
            problems.iter().any(|problem| problem.contains(name.as_str())),
            "{damage} in {name}: {problems:?}"
        );
        let is_needed = name == "manifest.json" || name.starts_with("tile_");
        match relit() {
            Ok(picture) if !is_needed => assert_eq!(picture.combined(), whole, "{damage} in {name}"),
            Err(error) => assert!(is_needed, "{damage} in {name} stops relighting: {error}"),
            Ok(_) => {}
        }
        std::fs::write(path.join(name), good).unwrap();
    }
    assert_eq!(validate(path, &monitor).unwrap(), [""; 0]);
}

#[test]
fn bakes_of_before_the_checksums_are_sound() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    baked(path);
    let contents = r#"{"format": "relume-contents", "version": 1, "files": ["guided.json", "lights.json"]}"#;
    std::fs::write(path.join("contents.json"), contents).unwrap();
    std::fs::write(path.join("shot.json"), SHOT.replace(r#", "checksum": "7cfb4d28""#, "")).unwrap();
    assert_eq!(validate(path, &Monitor::default()).unwrap(), [""; 0]);
}
