//! The command line. Doc comments are its help texts.

mod training;

use clap::{Args, Parser, Subcommand, ValueEnum};
use relume_session::{Device, MOST_PARTS};
use std::path::PathBuf;

pub use self::training::{EvaluateArgs, LightKindArg, NetworkArg, PlacementArg, TrainArgs};

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
    /// Seed of all random numbers; default is that of the scene file, or else 0.
    #[arg(long, global = true)]
    pub seed: Option<u64>,
    /// Device: auto (the best graphics card, else the CPU), cpu, gpu, or a name that `relume devices` prints, or a part
    /// of it. The place that it is at tells two cards of a name apart. Tracing is always done on the CPU.
    #[arg(long, global = true, default_value = "auto")]
    pub device: Device,
    /// Most GPU memory to use, MiB; default is what the driver says, less some for others. What does not fit is streamed.
    #[arg(long, global = true, value_name = "MIB")]
    pub gpu_memory: Option<u64>,
}

#[derive(Subcommand, Debug)]
pub enum Command {
    /// Trace the paths of a scene that Blender wrote, or of an OBJ file, into a bake folder.
    Trace(TraceArgs),
    /// Prepare bakes that many machines trace: a job folder, cut into parts.
    Plan(PlanArgs),
    /// Trace parts of a job. Exit code 75: a file could not be read or written, try again or elsewhere.
    Work(WorkArgs),
    /// Check what the machines have made, and name the parts that are missing or damaged.
    Collect(CollectArgs),
    /// Sum lights over a bake, without a proxy.
    Gather(GatherArgs),
    /// Train a proxy on a bake.
    Train(TrainArgs),
    /// Measure proxies on lights they never saw, against an independent bake with many more samples.
    Evaluate(EvaluateArgs),
    /// Relight a bake, or proxies without their bake, into an EXR and a PNG.
    Relight(RelightArgs),
    /// Find lights that make a target picture, or do what a request asks for.
    Optimise(OptimiseArgs),
    /// Say what a bake folder, proxy, light set or scene file is.
    Info(PathArgs),
    /// Check a bake folder, proxy, light set or scene file for damage.
    Validate(PathArgs),
    /// List the GPUs that --device can name.
    Devices,
}

#[derive(Args, Debug)]
pub struct TraceArgs {
    /// Scene file, as `relume export` writes it in Blender, or Wavefront OBJ file (.obj).
    pub scene: PathBuf,
    /// Bake folder to write.
    #[arg(long, short)]
    pub out: PathBuf,
    /// Go on with an interrupted bake, or add samples to a finished one.
    #[arg(long)]
    pub resume: bool,
    #[command(flatten)]
    pub settings: SettingsArgs,
}

#[derive(Args, Debug)]
pub struct PlanArgs {
    /// Scene files or OBJ files, such as one a frame. Each bake is in a folder of its scene file's name.
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Job folder to write.
    #[arg(long, short)]
    pub out: PathBuf,
    /// Parts of each bake.
    #[arg(long, default_value_t = 8)]
    pub parts: usize,
    /// Files to write besides, for a farm that does the job.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub emit: Vec<Farm>,
    #[command(flatten)]
    pub settings: SettingsArgs,
}

/// Farms that a job can be given to.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Farm {
    /// Open Job Description: template.json.
    Openjd,
    /// Open Job Description for farms that give several parts to a machine at a time.
    OpenjdChunks,
    /// Flamenco 3: a job type, which plans by itself.
    Flamenco,
    /// Slurm: slurm.sh, which submits the job.
    Slurm,
    /// Make, on this machine.
    Make,
}

#[derive(Args, Debug)]
pub struct WorkArgs {
    /// Job folder, or its plan.json.
    pub plan: PathBuf,
    /// Numbers of the parts, like 3 or 1-4,7.
    #[arg(long)]
    pub part: Parts,
}

#[derive(Args, Debug)]
pub struct CollectArgs {
    /// Job folder, or its plan.json.
    pub plan: PathBuf,
}

/// Numbers of parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts(pub Vec<usize>);

impl std::str::FromStr for Parts {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' names no parts; give numbers like 3 or 1-4,7");
        let mut parts = Vec::new();
        for range in text.split(',') {
            let (first, last) = range.split_once('-').unwrap_or((range, range));
            let number = |word: &str| word.trim().parse::<usize>().map_err(|_| wrong());
            let (first, last) = (number(first)?, number(last)?);
            if first == 0 || first > last || last > MOST_PARTS {
                return Err(wrong());
            }
            parts.extend(first..=last);
        }
        parts.sort_unstable();
        parts.dedup();
        Ok(Self(parts))
    }
}

/// Settings of a bake that replace those of its scene file.
#[derive(Args, Debug)]
pub struct SettingsArgs {
    /// Paths per pixel; default is that of the scene file, or 256.
    #[arg(long)]
    pub samples: Option<u32>,
    /// Most bounces of a path, in all and of each kind; default is those of the scene file, or 12.
    #[arg(long)]
    pub bounces: Option<u32>,
    /// Edge of the image tiles, pixels.
    #[arg(long, default_value_t = 64)]
    pub tile: usize,
    /// Light set to keep with the bake as the scene's own; its paths are guided towards those lights.
    #[arg(long)]
    pub lights: Option<PathBuf>,
    /// Light set that paths are guided towards as well, such as an answer of `optimise`.
    #[arg(long)]
    pub towards: Option<PathBuf>,
    #[command(flatten)]
    pub view: ViewArgs,
}

/// View and settings that a scene file has, and an OBJ file lacks.
#[derive(Args, Debug, Default, PartialEq)]
#[command(next_help_heading = "Of OBJ files alone")]
pub struct ViewArgs {
    /// Pixels per row; default is 640.
    #[arg(long)]
    pub width: Option<usize>,
    /// Rows; default is 360.
    #[arg(long)]
    pub height: Option<usize>,
    /// Camera position `x,y,z`, metres, z up; default frames the whole scene.
    #[arg(long, allow_hyphen_values = true)]
    pub eye: Option<Triple>,
    /// Point that the camera looks at, `x,y,z`; default is the middle of the scene.
    #[arg(long, allow_hyphen_values = true)]
    pub target: Option<Triple>,
    /// Angle across the longer edge of the picture, degrees; default is 40.
    #[arg(long)]
    pub fov: Option<f32>,
    /// Radiance of the world, `r,g,b`; default is black.
    #[arg(long)]
    pub world: Option<Triple>,
    /// Up axis of the file; default is y.
    #[arg(long, value_enum)]
    pub up: Option<Up>,
}

/// Up axis of an OBJ file.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
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

/// Output of pictures.
#[derive(Args, Debug)]
pub struct PictureArgs {
    /// Bake folder; `relight` also takes a folder of proxies.
    #[arg(required_unless_present = "shots")]
    pub bake: Option<PathBuf>,
    /// List of shots (JSON) in place of a bake folder; `{shot}` in --out stands for the name of each.
    #[arg(long, value_name = "FILE", conflicts_with = "bake")]
    pub shots: Option<PathBuf>,
    /// Contact sheet of all shots to write, PNG.
    #[arg(long, value_name = "FILE", requires = "shots", conflicts_with = "bake")]
    pub sheet: Option<PathBuf>,
    /// Multi-layer EXR to write; the PNG goes beside it.
    #[arg(long, short, required_unless_present = "sheet")]
    pub out: Option<PathBuf>,
    /// Light set (JSON); default is the lights that the scene came with.
    #[arg(long)]
    pub lights: Option<PathBuf>,
    /// Lights and factors on them, on the world and on emissive surfaces (JSON), as Blender's panel asks for a picture.
    #[arg(long, value_name = "FILE", conflicts_with = "lights")]
    pub request: Option<PathBuf>,
    /// Radiance `r,g,b` of another world than the baked one, or factor on --environment.
    #[arg(long)]
    pub world: Option<Triple>,
    /// Equirectangular EXR or PNG as another world than the baked one.
    #[arg(long)]
    pub environment: Option<PathBuf>,
    /// Scene file of the bake in place of the one in its folder: lights, small ones above all, have much less noise with it.
    #[arg(long)]
    pub scene: Option<PathBuf>,
    /// Do not denoise what is gathered.
    #[arg(long)]
    pub no_denoise: bool,
    /// Layers of each light by lobes, such as `Diffuse Direct_Key`, that add up to its layer. Lights are gathered then.
    #[arg(long)]
    pub lobes: bool,
    /// Names of the EXR's channels.
    #[arg(long, value_enum, default_value_t)]
    pub layout: LayoutArg,
    /// 32-bit floats in the EXR instead of 16-bit ones.
    #[arg(long)]
    pub float: bool,
    /// 16 bits in the PNG instead of 8.
    #[arg(long)]
    pub sixteen_bit: bool,
    /// View table for the PNG (N*N by N pixels); default is the one of the bake, or else the sRGB curve.
    #[arg(long)]
    pub view: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub struct GatherArgs {
    #[command(flatten)]
    pub picture: PictureArgs,
}

#[derive(Args, Debug)]
pub struct RelightArgs {
    /// Source of each light's picture.
    #[arg(long = "with", value_name = "WITH", value_enum, default_value = "auto")]
    pub method: MethodArg,
    #[command(flatten)]
    pub picture: PictureArgs,
}

/// Names of the channels of an EXR.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum LayoutArg {
    /// Blender's own: ViewLayer.Combined.R.
    #[default]
    Blender,
    /// For Nuke, Fusion and Natron: R of the picture, Combined_Key.R of its layers, without spaces.
    Plain,
}

/// Source of a light's picture.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MethodArg {
    /// Whichever has the lower measured error for this type of light.
    Auto,
    /// The bake.
    Gather,
    /// The proxy; lights of a type without proxy are gathered.
    Proxy,
}

#[derive(Args, Debug)]
pub struct OptimiseArgs {
    /// Bake folders, or folders of proxies: one for each view of the scene.
    #[arg(required_unless_present = "shots")]
    pub bakes: Vec<PathBuf>,
    /// List of shots (JSON) in place of folders. Goals name theirs, as "shot"; those that none names are left out.
    /// `{shot}` in --target stands for the name of each.
    #[arg(long, value_name = "FILE", conflicts_with = "bakes")]
    pub shots: Option<PathBuf>,
    /// Request (JSON): lights, free parameters, goals; pictures by paths relative to it. Without lights in it, those of
    /// the bake.
    #[arg(long, conflicts_with_all = ["target", "lights", "count"], required_unless_present = "target")]
    pub request: Option<PathBuf>,
    /// Short form: picture to match, EXR (scene-linear) or PNG (sRGB), of the bake's aspect.
    #[arg(long)]
    pub target: Option<PathBuf>,
    /// Short form: light set to start from; all of its lights are solved.
    #[arg(long)]
    pub lights: Option<PathBuf>,
    /// Short form: number of lights to find, if no light set is given.
    #[arg(long, default_value_t = 1)]
    pub count: usize,
    /// Starts, of which the best is kept.
    #[arg(long, default_value_t = 8)]
    pub starts: usize,
    /// Steps of each start.
    #[arg(long, default_value_t = 500)]
    pub iterations: usize,
    /// Share of the pixels that each step looks at.
    #[arg(long, default_value_t = 0.05)]
    pub pixel_fraction: f32,
    /// Most steps on gathered pictures afterwards, which take out the proxy's error; needs the bake.
    #[arg(long, default_value_t = 16)]
    pub polish: usize,
    /// Light set of an earlier answer, which is polished instead of searching anew: by a bake guided towards it.
    #[arg(long)]
    pub from: Option<PathBuf>,
    /// Keep positions and directions as they are.
    #[arg(long)]
    pub lock_center: bool,
    /// Keep sizes and cones as they are.
    #[arg(long)]
    pub lock_radius: bool,
    /// Keep colours and strengths as they are.
    #[arg(long)]
    pub lock_radiance: bool,
    /// Light set to write.
    #[arg(long, short)]
    pub out: PathBuf,
}

#[derive(Args, Debug)]
pub struct PathArgs {
    /// Bake folder, proxy, light set or scene file.
    pub path: PathBuf,
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
    fn parts_are_numbers_and_ranges() {
        assert_eq!("3".parse(), Ok(Parts(vec![3])));
        assert_eq!("7, 1-3,2".parse(), Ok(Parts(vec![1, 2, 3, 7])));
        for wrong in ["", "0", "4-2", "a", "1-", "-3", "1,,2", "1-99999999999"] {
            assert!(wrong.parse::<Parts>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn triples_are_three_finite_numbers() {
        assert_eq!("0,-2.5, 1".parse(), Ok(Triple([0.0, -2.5, 1.0])));
        for wrong in ["1,2", "1,2,3,4", "a,b,c", "1,2,nan", ""] {
            assert!(wrong.parse::<Triple>().is_err(), "{wrong}");
        }
    }
}
