use std::collections::HashMap;
use std::fmt::Write as _;
use std::sync::{LazyLock, Mutex, PoisonError};

use crate::device::IMMEDIATES;
use crate::{Binding, Gpu, GpuError, modules};

/// An entry point of a module, compiled. Its buffers are bindings 0, 1, 2 ... of group 0. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Kernel {
    pub(crate) pipeline: wgpu::ComputePipeline,
    device: wgpu::Device,
    label: String,
}

/// Checks of indices, divisors and loops in kernels, which cost a counter in every loop and a comparison at every
/// access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checks {
    /// They do.
    On,
    /// They do not.
    Off,
}

/// Kernels that a device has compiled so far.
#[derive(Debug, Default)]
pub(crate) struct Compiled {
    /// Modules by name and constants.
    modules: Mutex<HashMap<String, wgpu::ShaderModule>>,
    /// Kernels by module, constants and entry point.
    kernels: Mutex<HashMap<String, Kernel>>,
}

/// A kernel with its buffers. Keeps them alive on the device.
#[derive(Debug)]
pub struct Bound {
    pub(crate) pipeline: wgpu::ComputePipeline,
    pub(crate) group: wgpu::BindGroup,
}

impl Gpu {
    /// An entry point of a module of `shaders/`, with these values of its constants: compiled once a device.
    ///
    /// # Errors
    /// If the driver refuses it, or the device was lost.
    pub fn kernel(&self, module: &str, entry: &str, constants: &[(&str, u32)]) -> Result<Kernel, GpuError> {
        self.check()?;
        let module_key = with_constants(module, constants);
        let key = format!("{module_key}: {entry}");
        let known = || self.compiled().kernels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kernel) = known().get(&key) {
            return Ok(kernel.clone());
        }
        // Others go on meanwhile: drivers may take seconds.
        let shader = self.module(module, constants, module_key)?;
        let kernel = self.pipeline(module, &shader, entry)?;
        Ok(known().entry(key).or_insert(kernel).clone())
    }

    /// Compiles an entry point of a text that is not of `shaders/`, each time anew: for benchmarks, and for tests that stand in for
    /// what a device lacks.
    ///
    /// # Errors
    /// If the driver refuses it, or the device was lost.
    pub fn kernel_of_text(&self, name: &str, text: &str, entry: &str) -> Result<Kernel, GpuError> {
        self.check()?;
        let shader = self.compile(name, text.to_owned())?;
        self.pipeline(name, &shader, entry)
    }

    fn pipeline(&self, module: &str, shader: &wgpu::ShaderModule, entry: &str) -> Result<Kernel, GpuError> {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let label = format!("{module}: {entry}");
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(&label),
            layout: None,
            module: shader,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        self.refusal(module, [internal, scope])?;
        Ok(Kernel { pipeline, device: self.device.clone(), label })
    }

    fn module(
        &self,
        name: &str,
        constants: &[(&str, u32)],
        key: String,
    ) -> Result<wgpu::ShaderModule, GpuError> {
        let mut known = self.compiled().modules.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(module) = known.get(&key) {
            return Ok(module.clone());
        }
        let module = self.compile(name, modules::compose(name, constants)?)?;
        known.insert(key, module.clone());
        Ok(module)
    }

    fn compile(&self, name: &str, text: String) -> Result<wgpu::ShaderModule, GpuError> {
        let descriptor =
            wgpu::ShaderModuleDescriptor { label: Some(name), source: wgpu::ShaderSource::Wgsl(text.into()) };
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let checks = match self.checks() {
            Checks::On => wgpu::ShaderRuntimeChecks::checked(),
            Checks::Off => wgpu::ShaderRuntimeChecks::unchecked(),
        };
        // SAFETY: the modules are our own, from the table of this crate, and every kernel's tests run with all checks on
        // and without them.
        let module = unsafe { self.device.create_shader_module_trusted(descriptor, checks) };
        self.refusal(name, [scope])?;
        Ok(module)
    }

    /// Objection of the driver to a module since the scopes were opened.
    fn refusal<const N: usize>(
        &self,
        module: &str,
        scopes: [wgpu::ErrorScopeGuard; N],
    ) -> Result<(), GpuError> {
        // The last one opened is popped first.
        let errors = scopes.map(|scope| pollster::block_on(scope.pop()));
        self.check()?;
        match errors.into_iter().flatten().next() {
            None => Ok(()),
            Some(error) => Err(GpuError::Shader { module: module.to_owned(), reason: error.to_string() }),
        }
    }
}

impl Checks {
    /// Checks of dev builds, but where the environment sets `RELUME_GPU_UNCHECKED`, with which tests run the kernels
    /// that release builds have.
    pub(crate) fn of_this_build() -> Self {
        static CHECKS: LazyLock<Checks> = LazyLock::new(|| {
            let are_on = cfg!(debug_assertions) && std::env::var_os("RELUME_GPU_UNCHECKED").is_none();
            if are_on { Checks::On } else { Checks::Off }
        });
        *CHECKS
    }
}

/// A module's name and the values of its constants.
fn with_constants(module: &str, constants: &[(&str, u32)]) -> String {
    constants.iter().fold(module.to_owned(), |mut text, (constant, value)| {
        // Writing to a string cannot fail.
        let _ = write!(text, " {constant}={value}");
        text
    })
}

impl Kernel {
    /// Binds its buffers, in the order of their numbers.
    ///
    /// # Errors
    /// [`GpuError::Refused`] if they are not what the module declares.
    pub fn bind(&self, buffers: &[Binding<'_>]) -> Result<Bound, GpuError> {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let entries: Vec<_> = buffers
            .iter()
            .enumerate()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: binding as u32,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: buffer.raw,
                    offset: buffer.range.0,
                    size: std::num::NonZeroU64::new(buffer.range.1),
                }),
            })
            .collect();
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&self.label),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        match pollster::block_on(scope.pop()) {
            None => Ok(Bound { pipeline: self.pipeline.clone(), group }),
            Some(error) => Err(GpuError::Refused(format!("{}: {error}", self.label))),
        }
    }
}

/// Bytes of arguments, checked.
pub(crate) fn arguments(bytes: &[u8]) -> &[u8] {
    assert!(
        bytes.len() <= IMMEDIATES as usize && bytes.len().is_multiple_of(4),
        "{} bytes of arguments",
        bytes.len()
    );
    bytes
}
