//! Round trips, resuming, and hostile input.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

use std::fs;
use std::path::Path;

use glam::Vec3;
use relume_dump::{
    AovSample, Dump, DumpError, DumpWriter, End, FORMAT_VERSION, Lobe, Manifest, MemoryWriter, Pass, Segment,
    Shard, ShardSink, TileSamples,
};

fn manifest() -> Manifest {
    Manifest {
        format_version: FORMAT_VERSION,
        scene_hash: "abc".into(),
        width: 5,
        height: 3,
        tile_size: 4,
        passes: vec![Pass { first_sample: 0, samples: 2 }, Pass { first_sample: 2, samples: 3 }],
        seed: 7,
        camera: serde_json::json!({ "name": "Camera" }),
        camera_position: Some([1.0, 2.0, 3.0]),
        receivers: vec!["Floor".into(), "Ball".into()],
        classes: None,
        settings: serde_json::json!({ "bounces": 12 }),
        working_space: "Linear Rec.709".into(),
        world_color: [1.0; 3],
        world_map: String::new(),
        recorded: None,
    }
}

fn segment(end: End, lobe: Lobe, throughput: f32) -> Segment {
    let receiver = u16::from(lobe != Lobe::Camera);
    Segment { end, throughput: Vec3::splat(throughput), lobe, receiver, continues: false }
}

/// Pixel p, path k: camera -> (p, k, 0) -> (p, k, 10) -> escapes upwards.
fn samples(manifest: &Manifest, tile: usize, pass: usize) -> TileSamples {
    let rect = manifest.tile_rect(tile);
    let mut samples = TileSamples::new(rect);
    for pixel in 0..rect.pixel_count() {
        samples.begin_pixel();
        for path in 0..manifest.passes[pass].samples {
            let vertex = |z| End::Vertex(Vec3::new(pixel as f32, path as f32, z));
            samples.begin_path(None);
            samples.push(segment(vertex(0.0), Lobe::Camera, 1.0));
            samples.push(segment(vertex(10.0), Lobe::Diffuse, 0.5));
            samples.push(segment(End::Escape(Vec3::Z), Lobe::Glossy, 0.25));
            samples.add_aov(AovSample {
                albedo: Vec3::X,
                depth: (path == 0).then_some(4.0),
                ..Default::default()
            });
        }
    }
    samples
}

fn write_all(sink: &impl ShardSink) {
    let manifest = sink.manifest();
    for tile in 0..manifest.tile_count() {
        for pass in 0..manifest.passes.len() {
            if !sink.is_complete(tile, pass) {
                sink.write(tile, pass, &samples(manifest, tile, pass)).unwrap();
            }
        }
    }
}

#[test]
fn a_dump_returns_what_was_written() {
    let dir = tempfile::tempdir().unwrap();
    let writer = DumpWriter::create(dir.path(), manifest()).unwrap();
    write_all(&writer);
    let dump = writer.finish().unwrap();
    assert_eq!(dump.validate(), Vec::<String>::new());
    assert_eq!(dump.record_count(), 15 * 5 * 3);

    let (shard, pixel) = dump.pixel(4, 2).nth(1).unwrap();
    assert_eq!((shard.rect().width, pixel, shard.samples()), (1, 2, 3));
    let decoded: Vec<_> = shard.segments(pixel).collect();
    assert_eq!(decoded.len(), 9);
    assert_eq!(decoded[3].origin, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!((decoded[3].path, decoded[3].flags.lobe()), (1, Some(Lobe::Camera)));
    assert!(decoded[4].origin.distance(Vec3::new(2.0, 1.0, 0.0)) < 1e-4);
    assert_eq!((decoded[4].throughput, decoded[4].flags.receiver()), (Vec3::splat(0.5), 1));
    let End::Escape(direction) = decoded[5].end else { panic!("the third segment escapes") };
    assert!(direction.distance(Vec3::Z) < 1e-4);

    let aovs = dump.aovs();
    assert_eq!(aovs.albedo.pixel(4, 2), [1.0, 0.0, 0.0]);
    assert_eq!(aovs.depth.pixel(4, 2), [4.0]);
}

#[test]
fn memory_and_file_hold_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let writer = DumpWriter::create(dir.path(), manifest()).unwrap();
    let memory = MemoryWriter::new(manifest()).unwrap();
    write_all(&writer);
    write_all(&memory);
    let (files, memory) = (writer.finish().unwrap(), memory.snapshot());
    for (file, memory) in files.shards().zip(memory.shards()) {
        assert_eq!(file.as_bytes(), memory.as_bytes());
    }
}

#[test]
fn paths_without_a_pinhole_start_at_their_camera_vertex() {
    let manifest = Manifest { width: 1, height: 1, camera_position: None, ..manifest() };
    let mut samples = TileSamples::new(manifest.tile_rect(0));
    samples.begin_pixel();
    samples.begin_path(Some(Vec3::ONE));
    samples.push(segment(End::Vertex(Vec3::ZERO), Lobe::Camera, 1.0));
    samples.begin_path(None);
    let shard = Shard::encode(&manifest, 0, 0, &samples).unwrap();
    assert_eq!(shard.problems(2), Vec::<String>::new());
    let decoded: Vec<_> = shard.segments(0).collect();
    assert_eq!((decoded[0].origin, decoded[0].end), (Vec3::ONE, End::Vertex(Vec3::ZERO)));
    assert_eq!((decoded[1].path, decoded[1].throughput), (1, Vec3::ZERO));
}

/// One pixel of two paths, each camera -> (0, 0, 0) -> (0, 0, 1) -> (0, 0, 2) -> escapes, the last two straight on.
fn rays(manifest: &Manifest, camera_vertex: Option<Vec3>) -> TileSamples {
    let mut samples = TileSamples::new(manifest.tile_rect(0));
    samples.begin_pixel();
    for _ in 0..2 {
        samples.begin_path(camera_vertex);
        samples.push(segment(End::Vertex(Vec3::ZERO), Lobe::Camera, 1.0));
        samples.push(segment(End::Vertex(Vec3::Z), Lobe::Diffuse, 1.0));
        for end in [End::Vertex(2.0 * Vec3::Z), End::Escape(Vec3::Z)] {
            samples.push(Segment { continues: true, ..segment(end, Lobe::Diffuse, 0.5) });
        }
    }
    samples
}

#[test]
fn segments_that_continue_a_ray_know_where_it_began() {
    let near = |a: Vec3, b: Vec3| a.distance(b) < 1e-4;
    for camera_vertex in [None, Some(Vec3::ONE)] {
        let manifest = Manifest { width: 1, height: 1, ..manifest() };
        let shard = Shard::encode(&manifest, 0, 0, &rays(&manifest, camera_vertex)).unwrap();
        assert_eq!(shard.problems(2), Vec::<String>::new());
        assert_eq!(shard.segments(0).map(|s| s.path).collect::<Vec<_>>(), [0, 0, 0, 0, 1, 1, 1, 1]);
        let camera = camera_vertex.unwrap_or(shard.camera_position());
        let segments = (0..shard.record_count()).filter_map(|record| Some((record, shard.segment(record)?)));
        for (index, (record, segment)) in segments.enumerate() {
            let (start, ray) = [
                (camera, camera),
                (Vec3::ZERO, Vec3::ZERO),
                (Vec3::Z, Vec3::ZERO),
                (2.0 * Vec3::Z, Vec3::ZERO),
            ][index % 4];
            assert!(near(segment.origin, start) && near(shard.ray_origin(record), ray), "{segment:?}");
            assert_eq!(segment.flags.continues(), index % 4 > 1);
        }
    }
}

#[test]
fn segments_that_continue_nothing_are_refused() {
    let manifest = Manifest { width: 1, height: 1, ..manifest() };
    let continuing = |lobe| Segment { continues: true, ..segment(End::Vertex(Vec3::ONE), lobe, 1.0) };
    for camera_vertex in [None, Some(Vec3::ONE)] {
        let mut samples = TileSamples::new(manifest.tile_rect(0));
        samples.begin_pixel();
        for _ in 0..2 {
            samples.begin_path(camera_vertex);
            samples.push(continuing(Lobe::Camera));
        }
        let error = Shard::encode(&manifest, 0, 0, &samples).unwrap_err().to_string();
        let expected = if camera_vertex.is_some() { "continues no ray" } else { "is not the camera's" };
        assert!(error.contains(expected), "{error}");
    }
    // Forged: bit 0 of the flags of the first record, which then starts no path.
    let mut bytes = Shard::encode(&manifest, 0, 0, &rays(&manifest, None)).unwrap().as_bytes().to_vec();
    let shard = Shard::from_bytes(Path::new("x"), &bytes).unwrap();
    let place = shard.position_z_flags().as_ptr() as usize - shard.as_bytes().as_ptr() as usize;
    bytes[place + 2] ^= 1;
    let forged = Shard::from_bytes(Path::new("x"), &bytes).unwrap();
    let problems = forged.problems(2);
    assert!(
        problems.iter().any(|problem| problem.contains("continues a path that has ended")),
        "{problems:?}"
    );
}

#[test]
fn resume_keeps_complete_shards_and_bakes_damaged_ones_again() {
    let dir = tempfile::tempdir().unwrap();
    write_all(&DumpWriter::create(dir.path(), manifest()).unwrap());
    let damaged = Manifest::shard_path(dir.path(), 1, 0);
    let bytes = fs::read(&damaged).unwrap();
    fs::write(&damaged, &bytes[..bytes.len() - 1]).unwrap();
    let empty = Manifest::shard_path(dir.path(), 0, 1);
    fs::write(&empty, []).unwrap();
    assert!(Dump::open(dir.path()).unwrap_err().to_string().contains("the file is empty"));
    assert!(matches!(DumpWriter::create(dir.path(), manifest()), Err(DumpError::Exists { .. })));

    let writer = DumpWriter::resume(dir.path(), manifest()).unwrap();
    assert!(writer.is_complete(0, 0) && writer.is_complete(1, 1));
    assert!(!writer.is_complete(1, 0) && !writer.is_complete(0, 1));
    write_all(&writer);
    assert_eq!(fs::read(&damaged).unwrap(), bytes);

    let mut longer = manifest();
    longer.passes.push(Pass { first_sample: 5, samples: 5 });
    let writer = DumpWriter::resume(dir.path(), longer).unwrap();
    assert!(writer.is_complete(1, 1) && !writer.is_complete(0, 2));
    assert!(
        DumpWriter::resume(dir.path(), manifest()).unwrap().is_complete(1, 1),
        "fewer, and then more again"
    );
    let mut fuller = manifest();
    fuller.passes[1].samples = 4;
    let writer = DumpWriter::resume(dir.path(), fuller.clone()).unwrap();
    assert!(writer.is_complete(1, 0), "a rest that grows costs nothing but itself");
    assert!(!writer.is_complete(1, 1));
    fuller.passes.push(Pass { first_sample: 6, samples: 1 });
    let split = vec![Pass { first_sample: 0, samples: 1 }, Pass { first_sample: 1, samples: 4 }];
    let divided_otherwise = Manifest { passes: split, ..manifest() };
    for (one, two) in [(&manifest(), &divided_otherwise), (&divided_otherwise, &fuller)] {
        assert_eq!(one.difference(two), Some("sample range of a pass"));
    }
    let other = Manifest { scene_hash: "other".into(), ..manifest() };
    assert!(matches!(
        DumpWriter::resume(dir.path(), other),
        Err(DumpError::OtherBake { difference: "scene", .. })
    ));
}

#[test]
fn a_dump_of_another_version_is_another_bake() {
    let dir = tempfile::tempdir().unwrap();
    Manifest { format_version: FORMAT_VERSION + 1, ..manifest() }.write(dir.path()).unwrap();
    assert!(matches!(
        DumpWriter::resume(dir.path(), manifest()),
        Err(DumpError::OtherBake { difference: "format version", .. })
    ));
}

#[test]
fn an_unfinished_dump_opens_and_names_what_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let writer = DumpWriter::create(dir.path(), manifest()).unwrap();
    writer.write(1, 0, &samples(&manifest(), 1, 0)).unwrap();
    let dump = writer.finish().unwrap();
    assert_eq!(dump.missing(), [(0, 0), (0, 1), (1, 1)]);
    assert_eq!((dump.tile_samples(0), dump.tile_samples(1)), (0, 2));
    assert!(dump.validate().iter().any(|problem| problem == "tile 0, pass 1 is missing"));
    assert!(dump.aovs().albedo.data.iter().all(|value| value.is_finite()));
}

#[test]
fn every_truncation_is_one_error_that_names_the_file() {
    let shard = Shard::encode(&manifest(), 0, 0, &samples(&manifest(), 0, 0)).unwrap();
    let bytes = shard.as_bytes();
    for length in (0..bytes.len()).step_by(7).chain(bytes.len() - 16..bytes.len()) {
        let error = Shard::from_bytes(Path::new("shard.safetensors"), &bytes[..length]).unwrap_err();
        assert!(error.to_string().contains("shard.safetensors"), "{length}: {error}");
    }
    assert!(Shard::from_bytes(Path::new("x"), &[bytes, &[0]].concat()).is_err());
}

#[test]
fn every_flipped_bit_is_found_and_none_panics() {
    let shard = Shard::encode(&manifest(), 1, 0, &samples(&manifest(), 1, 0)).unwrap();
    let sound = shard.as_bytes().to_vec();
    let description_end = 8 + u64::from_le_bytes(sound[..8].try_into().unwrap()) as usize;
    for byte in 0..sound.len() {
        for bit in 0..8 {
            let mut bytes = sound.clone();
            bytes[byte] ^= 1 << bit;
            let Ok(read) = Shard::from_bytes(Path::new("x"), &bytes) else { continue };
            // Whoever gathers without validating must survive, too.
            let _ = (0..read.rect().pixel_count()).map(|pixel| read.segments(pixel).count()).sum::<usize>();
            let padding = byte < description_end && sound[byte] == b' ';
            assert!(padding || !read.problems(2).is_empty(), "bit {bit} of byte {byte}");
        }
    }
}

#[test]
fn validate_finds_what_a_checksum_cannot() {
    // A faulty tracer, or a forged file, with a checksum that fits.
    let manifest = Manifest { receivers: Vec::new(), width: 1, height: 1, ..manifest() };
    let sound = |end| {
        let mut samples = TileSamples::new(manifest.tile_rect(0));
        samples.begin_pixel();
        for _ in 0..2 {
            samples.begin_path(None);
            samples.push(segment(end, Lobe::Camera, 1.0));
            samples.push(segment(End::Escape(Vec3::Z), Lobe::Diffuse, 1.0));
        }
        Shard::encode(&manifest, 0, 0, &samples).unwrap()
    };
    assert!(sound(End::Vertex(Vec3::ONE)).problems(0).is_empty());
    let problems = sound(End::Escape(Vec3::X)).problems(0);
    assert!(problems[0].contains("continues a path that has ended"), "{problems:?}");
    let problems = sound(End::Vertex(Vec3::ONE)).problems(1);
    assert!(problems[0].contains("unknown receiver"), "{problems:?}");
}

#[test]
fn samples_that_do_not_fit_are_refused() {
    let manifest = manifest();
    let encode = |edit: &dyn Fn(&mut TileSamples)| {
        let mut samples = samples(&manifest, 1, 0);
        edit(&mut samples);
        Shard::encode(&manifest, 1, 0, &samples).unwrap_err().to_string()
    };
    let to = |point, throughput| segment(End::Vertex(point), Lobe::Diffuse, throughput);
    assert!(encode(&|s| s.begin_path(None)).contains("3 paths instead of 2"));
    assert!(encode(&|s| s.begin_pixel()).contains("4 of 3 pixels"));
    assert!(encode(&|s| s.push(to(Vec3::NAN, 1.0))).contains("not finite"));
    assert!(encode(&|s| s.push(to(Vec3::ZERO, f32::INFINITY))).contains("not finite"));
    assert!(encode(&|s| s.push(Segment { receiver: 2, ..to(Vec3::ZERO, 1.0) })).contains("unknown receiver"));
    assert!(encode(&|s| s.add_aov(AovSample { alpha: f32::NAN, ..Default::default() })).contains("AOV"));
}

#[test]
fn impossible_manifests_are_refused() {
    let refused = |edit: fn(&mut Manifest)| {
        let mut manifest = manifest();
        edit(&mut manifest);
        Dump::in_memory(manifest).unwrap_err().to_string()
    };
    assert!(refused(|m| m.width = 0).contains("width is 0"));
    assert!(refused(|m| m.tile_size = usize::MAX).contains("tile size"));
    assert!(refused(|m| m.passes.clear()).contains("no passes"));
    assert!(refused(|m| m.passes[1].first_sample = 3).contains("pass 1"));
    assert!(refused(|m| m.passes[1].samples = u32::MAX).contains("pass 1"));
    assert!(refused(|m| m.format_version = 99).contains("format version 99"));
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join(Manifest::FILE), b"{ \"format_version\": ").unwrap();
    assert!(Dump::open(dir.path()).unwrap_err().to_string().contains("manifest.json"));
}

#[test]
fn a_shard_of_another_bake_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let writer = DumpWriter::create(dir.path(), manifest()).unwrap();
    let other =
        Shard::encode(&Manifest { seed: 8, ..manifest() }, 0, 0, &samples(&manifest(), 0, 0)).unwrap();
    let path = Manifest::shard_path(dir.path(), 0, 0);
    fs::write(&path, other.as_bytes()).unwrap();
    assert!(Dump::open(dir.path()).unwrap_err().to_string().contains("another bake"));
    write_all(&writer);
    fs::rename(Manifest::shard_path(dir.path(), 0, 1), &path).unwrap();
    let problems = Dump::validate_dir(dir.path()).unwrap();
    assert!(problems.iter().any(|problem| problem.contains("not pass 0")), "{problems:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_one_error_and_leaves_no_file() {
    // A folder that cannot hold files stands in for the full disk: /proc refuses to create any.
    let writer = DumpWriter::create(Path::new("/proc/relume"), manifest());
    assert!(matches!(writer, Err(DumpError::Io { .. })));

    let dir = tempfile::tempdir().unwrap();
    let writer = DumpWriter::create(dir.path(), manifest()).unwrap();
    // The target is a folder, so the last step, the rename, fails.
    fs::create_dir(Manifest::shard_path(dir.path(), 0, 0)).unwrap();
    let error = writer.write(0, 0, &samples(&manifest(), 0, 0)).unwrap_err();
    assert!(matches!(error, DumpError::Io { .. }), "{error}");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2, "only the manifest and the folder are left");
}
