//! An OBJ file of any bytes (materials behind a zero byte) is refused, or can be traced.
#![no_main]

mod traced;

use libfuzzer_sys::fuzz_target;
use relume_session::{ObjView, obj_scene};
use std::fs;
use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = tempfile::tempdir().expect("a folder");
}

fuzz_target!(|bytes: &[u8]| FOLDER.with(|folder| {
    let mut parts = bytes.splitn(2, |&byte| byte == 0);
    let path = folder.path().join("room.obj");
    fs::write(&path, parts.next().unwrap_or_default()).expect("written");
    fs::write(folder.path().join("room.mtl"), parts.next().unwrap_or_default()).expect("written");
    let view = ObjView { width: 2, height: 2, ..ObjView::default() };
    let Ok(scene) = obj_scene(&path, &view) else { return };
    if scene.validate().is_err() {
        return;
    }
    traced::trace(&scene);
}));
