//! The program on whatever GPU there is, and where there is none.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{one_error, relume, trace_room};
use relume_session::image::{Image, read_exr};
use std::path::Path;
use std::process::Command;

/// `relume gather` on a device, in a desktop session of its own: Mesa's drivers complain where there is none.
fn gather(folder: &Path, out: &str, options: &str) -> Command {
    let mut command = relume(folder, &format!("gather bake --no-denoise --float --out {out} {options}"));
    command.args(["--lights", &common::data("evening.json").display().to_string()]);
    command.env("XDG_RUNTIME_DIR", folder);
    command
}

fn picture(folder: &Path, out: &str, options: &str) -> Image {
    let output = gather(folder, out, options).output().expect("the program starts");
    assert!(output.status.success(), "{options}: {}", String::from_utf8_lossy(&output.stderr));
    let layers = read_exr(&folder.join(out)).unwrap();
    layers.layers.into_iter().find(|layer| layer.name == "Combined").unwrap().image
}

#[test]
fn pictures_are_the_same_on_every_device_and_in_any_memory() {
    let folder = tempfile::tempdir().unwrap();
    // More than a mebibyte of records, so that one mebibyte has to be streamed.
    trace_room(folder.path(), "--out bake --width 48 --height 40 --samples 32 --tile 16");
    let cpu = picture(folder.path(), "cpu.exr", "--device cpu");
    for (out, options) in [("gpu.exr", "--device gpu"), ("streamed.exr", "--device gpu --gpu-memory 1")] {
        let gpu = picture(folder.path(), out, options);
        let mean = cpu.data.iter().sum::<f32>() / cpu.data.len() as f32;
        // A segment that grazes a light may be decided otherwise.
        let different = gpu.data.iter().zip(&cpu.data).filter(|(a, b)| (*a - *b).abs() > 1e-3 * mean).count();
        assert!(
            mean > 0.0 && different * 1000 < cpu.data.len(),
            "{options}: {different} values of {}",
            cpu.data.len()
        );
    }
    let output = gather(folder.path(), "none.exr", "--device gpu --gpu-memory 0").output().unwrap();
    assert!(one_error(&output).contains("not enough GPU memory"));
    assert!(!folder.path().join("none.exr").exists());
}

/// A GPU that was asked for and cannot be had is an error that says why and what to do; `auto` takes the CPU.
fn check_without_gpu(folder: &Path, hide: impl Fn(&mut Command)) {
    trace_room(folder, "--out bake --width 8 --height 8 --samples 4");
    let on = |out: &str, device: &str| {
        let mut command = gather(folder, out, &format!("--device {device}"));
        hide(&mut command);
        command.output().expect("the program starts")
    };
    let message = one_error(&on("a.exr", "gpu"));
    // A machine with a card may lack its driver, which is what happens here.
    let reasons = ["no GPU was found", "no driver offers it"];
    let says_why = reasons.iter().any(|reason| message.contains(reason));
    assert!(says_why && message.contains("libvulkan1") && message.contains("--device cpu"), "{message}");
    assert!(!folder.join("a.exr").exists());
    assert!(on("b.exr", "auto").status.success());
    assert!(folder.join("b.exr").exists());
}

#[test]
fn without_a_driver_a_gpu_that_was_asked_for_is_an_error_and_auto_takes_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    check_without_gpu(folder.path(), |command| {
        // Two generations of the Vulkan loader call it by two names.
        command.env("VK_DRIVER_FILES", "/nowhere.json").env("VK_ICD_FILENAMES", "/nowhere.json");
    });
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_vulkan_loader_it_is_so_too() {
    let folder = tempfile::tempdir().unwrap();
    // A file that is found first and is no library hides the one of the system.
    for name in ["libvulkan.so.1", "libvulkan.so"] {
        std::fs::write(folder.path().join(name), "no library").unwrap();
    }
    let others = std::env::var("LD_LIBRARY_PATH").unwrap_or_default();
    let path = format!("{}:{others}", folder.path().display());
    check_without_gpu(folder.path(), |command| {
        command.env("LD_LIBRARY_PATH", &path);
    });
}
