//! Finds Open Image Denoise: `OIDN_DIR` is a folder with `lib/libOpenImageDenoise.so` (on Windows with the import library
//! `lib/OpenImageDenoise.lib`), which `.cargo/config.toml` points into the virtual environment that `make setup` makes. Without
//! it everything builds, and the denoiser says what is missing.

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    println!("cargo::rustc-check-cfg=cfg(oidn)");
    println!("cargo::rerun-if-env-changed=OIDN_DIR");
    let Some(lib) = env::var_os("OIDN_DIR").map(|dir| PathBuf::from(dir).join("lib")) else {
        return;
    };
    println!("cargo::rerun-if-changed={}", lib.display());
    if !lib.join(library_name()).exists() {
        println!("cargo::warning=built without denoiser: no OIDN in {}; run make setup", lib.display());
        return;
    }
    println!("cargo::rustc-cfg=oidn");
    if let Err(error) = link_libraries(&lib) {
        println!("cargo::warning=tests will need LD_LIBRARY_PATH={}: {error}", lib.display());
    }
}

/// File name that the linker of the target looks for.
fn library_name() -> &'static str {
    match env::var("CARGO_CFG_TARGET_OS").as_deref() {
        Ok("windows") => "OpenImageDenoise.lib",
        Ok("macos") => "libOpenImageDenoise.dylib",
        _ => "libOpenImageDenoise.so",
    }
}

/// Cargo lets `cargo run` and `cargo test` find libraries in search paths below `OUT_DIR`, and only those.
#[cfg(unix)]
fn link_libraries(lib: &Path) -> std::io::Result<()> {
    let link = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("lib");
    if link.is_symlink() {
        fs::remove_file(&link)?;
    }
    std::os::unix::fs::symlink(lib, &link)?;
    println!("cargo::rustc-link-search=native={}", link.display());
    Ok(())
}

#[cfg(not(unix))]
fn link_libraries(_lib: &Path) -> std::io::Result<()> {
    Err(std::io::Error::other("no symbolic links here"))
}
