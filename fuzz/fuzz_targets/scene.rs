//! A scene file of any bytes is refused, or can be traced.
#![no_main]

mod traced;

use relume_session::SceneFile;
use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(SceneFile { mut scene, .. }) = SceneFile::from_bytes(Path::new("fuzz"), bytes) else { return };
    (scene.camera.width, scene.camera.height) = (2, 2);
    traced::trace(&scene);
});
