//! The WGSL files of `shaders/`, embedded. Comments at the top of a file say what it builds on:
//!
//! ```text
//! // use: common/packing           the declarations of another file
//! // constant: LIGHTS 8            a `const LIGHTS: u32` that whoever makes the kernel may set; 8 if not
//! // choose: LARGE a/small a/large  the declarations of one of some files: of the first if the constant is 0
//! ```
//!
//! `enable` directives move to the top of what is put together.

use std::fmt::Write as _;

use crate::GpuError;

macro_rules! files {
    ($($name:literal),* $(,)?) => {
        /// Every file by its path below `shaders/`, without the ending, and its text.
        pub const FILES: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../../../shaders/", $name, ".wgsl")))),*];
    };
}

files![
    "common/add_units",
    "common/compare",
    "common/matrices",
    "common/matrices_16",
    "common/matrices_8",
    "common/mean",
    "common/packing",
    "common/pull_units",
    "common/residual",
    "common/sum",
    "common/units",
    "gather/blocks",
    "gather/bounds",
    "gather/images",
    "gather/light",
    "gather/numbers",
    "gather/pixel",
    "gather/records",
    "gather/row",
    "gather/shard",
    "gather/slopes",
    "gather/soft",
    "gather/targets",
    "gather/world",
    "proxy/block",
    "proxy/collect",
    "proxy/features",
    "proxy/grid",
    "proxy/infer",
    "proxy/light_gradient",
    "proxy/light_sums",
    "proxy/matrices",
    "proxy/network",
    "proxy/pixels",
    "proxy/rows",
    "selftest",
    "subgroup",
    "train/batch",
    "train/chains",
    "train/dense",
    "train/inputs",
    "train/layers",
    "train/loss",
    "train/muon",
    "train/optimise",
    "train/parameters",
    "train/pool",
    "train/product",
    "train/product_matrices",
    "train/reduce",
    "train/scatter",
    "train/slots",
    "train/store",
    "train/targets",
    "train/values",
    "train/weights",
];

/// The text of a module: its file and all that it uses, with the constants given here or by the files.
///
/// # Errors
/// If there is no such file or constant.
pub fn compose(name: &str, constants: &[(&str, u32)]) -> Result<String, GpuError> {
    compose_text(embedded_file(name).map_err(|reason| shader_error(name, reason))?, constants)
}

/// The text of a module whose own file, a name and a text, is none of [`FILES`]; what it uses is.
///
/// # Errors
/// If there is no such constant, or no file that it uses.
pub fn compose_text((name, text): (&str, &str), constants: &[(&str, u32)]) -> Result<String, GpuError> {
    let fail = |reason: String| shader_error(name, reason);
    let mut files = Vec::new();
    collect((name, text), constants, &mut files).map_err(fail)?;
    let mut declared = Vec::new();
    for (_, text) in &files {
        for line in directives(text, "constant") {
            let (constant, value) =
                line.split_once(' ').ok_or_else(|| fail(format!("'{line}' has no value")))?;
            let value = value.trim().parse::<u32>().map_err(|error| fail(format!("{line}: {error}")))?;
            declared.push((constant, value));
        }
    }
    if let Some((unknown, _)) =
        constants.iter().find(|(name, _)| declared.iter().all(|(known, _)| known != name))
    {
        return Err(fail(format!("it has no constant {unknown}")));
    }
    let mut composed = String::new();
    let is_enable = |line: &&str| line.starts_with("enable ");
    let mut enables: Vec<&str> = files.iter().flat_map(|(_, text)| text.lines().filter(is_enable)).collect();
    enables.sort_unstable();
    enables.dedup();
    enables.iter().for_each(|line| composed.push_str(&format!("{line}\n")));
    for (constant, default) in declared {
        let value = constants.iter().find(|(name, _)| *name == constant).map_or(default, |(_, value)| *value);
        // Writing to a string cannot fail.
        let _ = writeln!(composed, "const {constant}: u32 = {value}u;");
    }
    for (name, text) in files {
        let _ = writeln!(composed, "// {name}.wgsl");
        text.lines().filter(|line| !is_enable(line)).for_each(|line| composed.push_str(&format!("{line}\n")));
    }
    Ok(composed)
}

/// A file and all that it uses, each once, what is used first.
fn collect<'a>(
    (name, text): (&'a str, &'a str),
    constants: &[(&str, u32)],
    files: &mut Vec<(&'a str, &'a str)>,
) -> Result<(), String> {
    if files.iter().any(|(known, _)| *known == name) {
        return Ok(());
    }
    for line in directives(text, "choose") {
        let mut words = line.split(' ');
        let constant = words.next();
        let set = constants.iter().find(|(name, _)| Some(*name) == constant).map_or(0, |(_, value)| *value);
        let chosen = words.nth(set as usize).ok_or_else(|| format!("'{line}' has no choice {set}"))?;
        collect(embedded_file(chosen)?, constants, files)?;
    }
    for used in directives(text, "use") {
        collect(embedded_file(used)?, constants, files)?;
    }
    files.push((name, text));
    Ok(())
}

fn embedded_file(name: &str) -> Result<(&'static str, &'static str), String> {
    let file = FILES.iter().find(|(known, _)| *known == name);
    file.copied().ok_or_else(|| format!("there is no file {name}.wgsl"))
}

fn shader_error(module: &str, reason: String) -> GpuError {
    GpuError::Shader { module: module.to_owned(), reason }
}

/// Texts that follow `// <word>:` on the lines of a file.
fn directives<'a>(text: &'a str, word: &str) -> impl Iterator<Item = &'a str> {
    let start = format!("// {word}: ");
    text.lines().filter_map(move |line| line.strip_prefix(&start)).map(str::trim)
}

/// Parses and validates a module without a GPU, with all features that kernels may use.
///
/// # Errors
/// Errors of the compiler.
pub fn validate(name: &str, constants: &[(&str, u32)]) -> Result<naga::Module, GpuError> {
    validate_composed(name, &compose(name, constants)?)
}

/// [`validate`] of a module that [`compose_text`] puts together.
///
/// # Errors
/// Errors of the compiler.
pub fn validate_text(file: (&str, &str), constants: &[(&str, u32)]) -> Result<naga::Module, GpuError> {
    validate_composed(file.0, &compose_text(file, constants)?)
}

fn validate_composed(name: &str, text: &str) -> Result<naga::Module, GpuError> {
    let fail = |reason: String| shader_error(name, reason);
    let capabilities = naga::valid::Capabilities::all();
    let mut frontend = naga::front::wgsl::Frontend::new_with_options(naga::front::wgsl::Options {
        capabilities,
        ..naga::front::wgsl::Options::new()
    });
    let module = frontend.parse(text).map_err(|error| fail(error.emit_to_string(text)))?;
    let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), capabilities);
    validator.validate(&module).map_err(|error| fail(error.emit_to_string(text)))?;
    Ok(module)
}
