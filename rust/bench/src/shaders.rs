//! WGSL of the benchmarks alone, which builds on that of the stages ([`relume_gpu::modules`]).

use relume_gpu::modules::compose_text;
use relume_gpu::{Gpu, GpuError, Kernel};

macro_rules! files {
    ($($name:literal),* $(,)?) => {
        /// Every file of `rust/bench/shaders` by its name, without the ending, and its text.
        const FILES: &[(&str, &str)] = &[$(($name, include_str!(concat!("../shaders/", $name, ".wgsl")))),*];
    };
}

files!["paper", "peak", "peak_half", "peak_matrices", "peak_read"];

fn file(name: &str) -> Result<(&'static str, &'static str), GpuError> {
    let file = FILES.iter().find(|(known, _)| *known == name);
    let reason = || "the benchmarks have no such file".into();
    file.copied().ok_or_else(|| GpuError::Shader { module: name.into(), reason: reason() })
}

/// Compiles an entry point of one of the files, with these values of its constants.
///
/// # Errors
/// If the driver refuses it, or the device was lost.
pub fn kernel(gpu: &Gpu, name: &str, entry: &str, constants: &[(&str, u32)]) -> Result<Kernel, GpuError> {
    gpu.kernel_of_text(name, &compose_text(file(name)?, constants)?, entry)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use naga::back::spv;
    use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
    use relume_gpu::Matrices;
    use relume_gpu::modules::validate_text;

    /// Bytes of the `Arguments` of a module, and its fields with their offsets.
    pub fn arguments(name: &str) -> (u32, Vec<(String, u32)>) {
        let module = validate_text(file(name).unwrap(), &[]).unwrap();
        let (_, found) =
            module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some("Arguments")).expect("arguments");
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{found:?}") };
        (*span, members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset)).collect())
    }

    /// The value of a `const` of a module.
    pub fn constant(name: &str, of: &str) -> u32 {
        let module = validate_text(file(name).unwrap(), &[]).unwrap();
        let (_, found) =
            module.constants.iter().find(|(_, constant)| constant.name.as_deref() == Some(of)).expect("it");
        match module.global_expressions[found.init] {
            naga::Expression::Literal(naga::Literal::U32(value)) => value,
            ref other => panic!("{other:?}"),
        }
    }

    fn valid(name: &str, constants: &[(&str, u32)]) -> (naga::Module, ModuleInfo) {
        let module = validate_text(file(name).unwrap(), constants).unwrap_or_else(|error| panic!("{error}"));
        let info = Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).unwrap();
        (module, info)
    }

    /// NVIDIA's matrices, AMD's and those of Mesa's software; of other modules no constants.
    fn constants(name: &str) -> Vec<Vec<(&'static str, u32)>> {
        let matrices = |(side, subgroup)| Matrices { side, subgroup }.constants().to_vec();
        if name == "peak_matrices" { [(16, 32), (16, 64), (8, 8)].map(matrices).into() } else { vec![vec![]] }
    }

    /// Not every driver has cooperative matrices, and the compiler was seen to give up on such modules only when it writes them.
    #[test]
    fn every_entry_point_is_valid_and_can_be_written_as_spirv() {
        for (name, constants) in
            FILES.iter().flat_map(|(name, _)| constants(name).into_iter().map(move |of| (name, of)))
        {
            let (module, info) = valid(name, &constants);
            assert!(!module.entry_points.is_empty(), "{name}");
            for entry in &module.entry_points {
                let options = spv::Options { lang_version: (1, 6), ..spv::Options::default() };
                let pipeline =
                    spv::PipelineOptions { shader_stage: entry.stage, entry_point: entry.name.clone() };
                let words = spv::write_vec(&module, &info, &options, Some(&pipeline));
                assert!(words.unwrap_or_else(|error| panic!("{name}: {error}")).len() > 100);
            }
        }
    }

    #[test]
    fn a_file_that_there_is_not_is_an_error_that_names_it() {
        assert!(file("peaks").unwrap_err().to_string().contains("peaks"));
    }
}
