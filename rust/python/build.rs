//! Tells the loader where the wheel keeps its own Open Image Denoise. A copy that the host (Blender) has loaded before
//! goes first, because it carries the same soname.

fn main() {
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
        println!("cargo::rustc-link-arg-cdylib=-Wl,-rpath,$ORIGIN/oidn/lib");
    }
}
