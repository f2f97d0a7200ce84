//! The command line. Doc comments are its help texts.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Relights finished shots: traces paths once, sums any lights over them, learns a proxy, solves lights.
#[derive(Parser, Debug)]
#[command(name = "relume", version, infer_subcommands = false, arg_required_else_help = false)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    pub global: Global,
}

/// Options of every command.
#[derive(Args, Debug, Clone)]
pub struct Global {
    /// Print progress, warnings and results as JSON lines on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// Print no progress.
    #[arg(long, global = true)]
    pub quiet: bool,
    /// Worker threads; 0 takes one a core. Never changes a result.
    #[arg(long, global = true, default_value_t = 0)]
    pub threads: usize,
    /// Seed of all random numbers.
    #[arg(long, global = true, default_value_t = 0)]
    pub seed: u64,
}

#[derive(Subcommand, Debug)]
pub enum Command {
    /// Trace the paths of an OBJ scene into a bake folder.
    Trace(TraceArgs),
}

#[derive(Args, Debug)]
pub struct TraceArgs {
    /// Wavefront OBJ file.
    pub scene: PathBuf,
    /// Bake folder to write.
    #[arg(long, short)]
    pub out: PathBuf,
    /// Go on with an interrupted bake, or add samples to a finished one.
    #[arg(long)]
    pub resume: bool,
    /// Paths per pixel.
    #[arg(long, default_value_t = 256)]
    pub samples: u32,
    /// Most bounces of a path, of any kind.
    #[arg(long, default_value_t = 12)]
    pub bounces: u32,
    /// Edge of the image tiles, pixels.
    #[arg(long, default_value_t = 64)]
    pub tile: usize,
    /// Pixels per row.
    #[arg(long, default_value_t = 640)]
    pub width: usize,
    /// Rows.
    #[arg(long, default_value_t = 360)]
    pub height: usize,
    /// Camera position `x,y,z`, metres, z up; default frames the whole scene.
    #[arg(long, allow_hyphen_values = true)]
    pub eye: Option<Triple>,
    /// Point that the camera looks at, `x,y,z`; default is the middle of the scene.
    #[arg(long, allow_hyphen_values = true)]
    pub target: Option<Triple>,
    /// Angle across the longer edge of the picture, degrees.
    #[arg(long, default_value_t = 40.0)]
    pub fov: f32,
    /// Radiance of the world, `r,g,b`.
    #[arg(long, default_value = "0,0,0")]
    pub world: Triple,
    /// Up axis of the file.
    #[arg(long, value_enum, default_value = "y")]
    pub up: Up,
    /// Light set to keep with the bake as the scene's own.
    #[arg(long)]
    pub lights: Option<PathBuf>,
}

/// Up axis of an OBJ file.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Up {
    Y,
    Z,
}

/// Three numbers, `x,y,z`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triple(pub [f32; 3]);

impl std::str::FromStr for Triple {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f32> =
            text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().map_err(|_| three())?;
        let numbers: [f32; 3] = numbers.try_into().map_err(|_| three())?;
        if numbers.iter().all(|n| n.is_finite()) { Ok(Self(numbers)) } else { Err(three()) }
    }
}

fn three() -> String {
    "give three numbers like 0,-2.5,1".into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn triples_are_three_finite_numbers() {
        assert_eq!("0,-2.5, 1".parse(), Ok(Triple([0.0, -2.5, 1.0])));
        for wrong in ["1,2", "1,2,3,4", "a,b,c", "1,2,nan", ""] {
            assert!(wrong.parse::<Triple>().is_err(), "{wrong}");
        }
    }
}
