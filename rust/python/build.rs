//! Tells the loader where the wheel keeps its own Open Image Denoise. A copy that the host (Blender) has loaded before
//! goes first, because it carries the same soname.

fn main() {
    let folder_of_the_module = match std::env::var("CARGO_CFG_TARGET_OS").as_deref() {
        Ok("linux") => "$ORIGIN",
        Ok("macos") => "@loader_path",
        _ => return,
    };
    println!("cargo::rustc-link-arg-cdylib=-Wl,-rpath,{folder_of_the_module}/oidn/lib");
}
