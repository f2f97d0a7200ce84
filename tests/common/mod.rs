//! Runs the `relume` program as a user would.

#![allow(dead_code, reason = "each test file uses a part of it")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The program; where `scripts/gpu-check` runs tests that were built elsewhere, it says which.
pub fn program() -> String {
    std::env::var("CARGO_BIN_EXE_relume").unwrap_or_else(|_| env!("CARGO_BIN_EXE_relume").into())
}

/// A file of `tests/data`.
pub fn data(name: &str) -> PathBuf {
    // At run time, which is where they lie if this was built elsewhere.
    let package = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").into());
    Path::new(&package).join("../../tests/data").join(name)
}

/// `relume` with arguments, in words.
pub fn relume(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(program());
    command.current_dir(folder).args(arguments.split_whitespace()).arg("--quiet");
    command
}

/// Runs it to the end.
pub fn run(folder: &Path, arguments: &str) -> Output {
    relume(folder, arguments).output().expect("the program starts")
}

/// Runs it and returns its JSON result.
pub fn result(folder: &Path, arguments: &str) -> serde_json::Value {
    let output = run(folder, &format!("{arguments} --json"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "relume {arguments}: {text}{}", String::from_utf8_lossy(&output.stderr));
    let line = text.lines().find(|line| line.contains("\"event\":\"result\"")).expect("a result");
    serde_json::from_str(line).expect("JSON")
}

/// Runs it, expects a failure, and returns the one line that says why.
pub fn failure(folder: &Path, arguments: &str) -> String {
    let output = run(folder, arguments);
    one_error(&output)
}

/// The one error line of a failed run.
pub fn one_error(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "succeeded: {text}");
    assert!(output.status.code().is_some(), "died of a signal: {text}");
    let errors: Vec<&str> = text.lines().filter(|line| line.contains("error")).collect();
    assert!(errors.len() == 1 && !text.contains("panicked"), "{text}");
    errors[0].to_string()
}

/// Traces the room of `tests/data` into `bake`.
pub fn trace_room(folder: &Path, options: &str) -> serde_json::Value {
    result(folder, &room(options))
}

/// Arguments that trace the room.
pub fn room(options: &str) -> String {
    let scene = data("room.obj");
    format!("trace {} --up z --eye 0,-4.2,1 --target 0,0,1 --fov 36 {options}", scene.display())
}

/// Names and contents of all files of a folder, sorted.
pub fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry"))
        .map(|entry| (entry.file_name().to_string_lossy().into_owned(), std::fs::read(entry.path()).unwrap()))
        .collect();
    files.sort();
    files
}
