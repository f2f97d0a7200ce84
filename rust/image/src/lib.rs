//! Float images: one type, files in and out, view transforms, error metrics. Knows nothing of scenes or light.

mod atomic;
mod error;
mod exr_file;
mod flip;
mod image;
mod letters;
pub mod metrics;
mod picture;
mod sheet;
mod ssim;
mod view;

pub use atomic::{replace_file, write_atomically};
pub use error::ImageError;
pub use exr_file::{Layer, LayeredImage, Precision, read_exr, write_exr};
pub use image::Image;
pub use picture::{BitDepth, read_picture, write_png, write_shown};
pub use sheet::{Cell, sheet};
pub use view::{ViewTransform, linear_from_srgb, srgb_from_linear};
