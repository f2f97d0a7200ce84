use std::str::FromStr;
use std::sync::Arc;

use relume_gpu::{Gpu, GpuChoice};

use crate::SessionError;

/// Where to compute.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// The best graphics card; the CPU where there is none, or where it fails.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// This GPU, or an error.
    Gpu(GpuChoice),
}

impl FromStr for Device {
    type Err = std::convert::Infallible;

    /// `auto`, `cpu`, `gpu` (the best, software drivers included), or a part of a GPU's name.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "auto" => Self::Auto,
            "cpu" => Self::Cpu,
            "gpu" => Self::Gpu(GpuChoice::Best),
            name => Self::Gpu(GpuChoice::Named(name.to_owned())),
        })
    }
}

impl Device {
    /// Opens it. `memory` bytes are a GPU's budget for everything that we put there; if not given, what its driver says, less
    /// what others may need.
    ///
    /// # Errors
    /// If a GPU was asked for and there is none, or it cannot be used.
    pub fn open(&self, memory: Option<u64>) -> Result<Compute, SessionError> {
        let gpu = match self {
            Self::Cpu => None,
            Self::Auto => Gpu::shared(&GpuChoice::BestHardware).ok(),
            Self::Gpu(choice) => Some(Gpu::shared(choice)?),
        };
        if let (Some(gpu), Some(bytes)) = (&gpu, memory) {
            gpu.set_memory_budget(bytes);
        }
        Ok(Compute { gpu, may_fall_back: *self == Self::Auto })
    }
}

/// An open device.
#[derive(Clone, Debug, Default)]
pub struct Compute {
    /// The GPU; none if the CPU does everything.
    pub gpu: Option<Arc<Gpu>>,
    /// Whether the CPU may go on where the GPU fails.
    pub may_fall_back: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_names_are_devices() {
        assert_eq!("auto".parse(), Ok(Device::Auto));
        assert_eq!("cpu".parse(), Ok(Device::Cpu));
        assert_eq!("gpu".parse(), Ok(Device::Gpu(GpuChoice::Best)));
        assert_eq!("RTX 5090".parse(), Ok(Device::Gpu(GpuChoice::Named("RTX 5090".into()))));
    }

    #[test]
    fn the_cpu_is_no_gpu_and_a_missing_one_is_an_error() {
        assert!(Device::Cpu.open(None).unwrap().gpu.is_none());
        assert!(Device::Gpu(GpuChoice::Best).open(None).unwrap().gpu.is_some());
        let error = Device::Gpu(GpuChoice::Named("no such card".into())).open(None).unwrap_err();
        assert!(error.to_string().contains("no such card"), "{error}");
    }
}
