/// Errors of a GPU. Each message names the next step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// No driver, or only drivers of back ends that are not used.
    #[error(
        "no GPU was found: install the driver of your graphics card and, on Linux, the Vulkan loader \
         (libvulkan1); or use the CPU (--device cpu, or the device in Blender's preferences)"
    )]
    NoAdapter,
    /// The system shows a graphics card, but no driver offers it.
    #[error(
        "there is a graphics card, but no driver offers it to programs: install its Vulkan driver and the Vulkan loader \
         (libvulkan1), and see that this user may open /dev/dri or /dev/nvidia*; or use the CPU (--device cpu, or the \
         device in Blender's preferences)"
    )]
    NoDriver,
    /// No adapter of this name.
    #[error(
        "no GPU is called '{name}'; there are: {found}; or use the CPU (--device cpu, or the device in \
         Blender's preferences)"
    )]
    NotFound {
        /// Requested name.
        name: String,
        /// Names of those that there are, and where they are plugged in.
        found: String,
    },
    /// The driver lacks what every kernel needs.
    #[error(
        "{adapter} cannot be used: {missing}; update its driver, or use the CPU (--device cpu, or the device in \
         Blender's preferences)"
    )]
    Unsuitable {
        /// Name of the adapter.
        adapter: String,
        /// Missing feature, in words.
        missing: String,
    },
    /// A buffer does not fit into the memory budget, or into what the driver has left.
    #[error(
        "not enough GPU memory for {what}: {needed} MiB are needed, {free} MiB are free of the budget; raise \
         --gpu-memory, close other programs, or use the CPU (--device cpu, or the device in Blender's \
         preferences)"
    )]
    OutOfMemory {
        /// Label of the buffer.
        what: String,
        /// Mebibytes, rounded up.
        needed: u64,
        /// Mebibytes, rounded down.
        free: u64,
    },
    /// The driver's memory ran out while it did something else than to make a buffer.
    #[error(
        "the GPU's driver ran out of memory ({0}); close other programs, lower --gpu-memory, or use the CPU (--device \
         cpu, or the device in Blender's preferences)"
    )]
    DriverOutOfMemory(String),
    /// A single buffer above the driver's limit.
    #[error(
        "{what} is larger than a buffer of this GPU can be ({limit} MiB); use the CPU (--device cpu, or the \
         device in Blender's preferences)"
    )]
    TooLarge {
        /// Label of the buffer.
        what: String,
        /// Mebibytes.
        limit: u64,
    },
    /// More memory than a workgroup has, or kernels ask it for.
    #[error(
        "{what} does not fit into the memory that a workgroup of a GPU has; use the CPU (--device cpu, or the \
         device in Blender's preferences)"
    )]
    TooWide {
        /// Name of the buffer.
        what: String,
    },
    /// The driver reset the device, or it was removed. Everything on it is gone.
    #[error(
        "the GPU was lost ({0}); start again, or use the CPU (--device cpu, or the device in Blender's \
         preferences)"
    )]
    Lost(String),
    /// A WGSL module that this driver does not take.
    #[error(
        "the GPU's driver refuses the shader {module}: {reason}; please report this, and use the CPU (--device \
         cpu, or the device in Blender's preferences)"
    )]
    Shader {
        /// Name of the module.
        module: String,
        /// Message of the compiler.
        reason: String,
    },
    /// A mistake of ours that the validation found.
    #[error(
        "the GPU refused a command: {0}; please report this, and use the CPU (--device cpu, or the device in \
         Blender's preferences)"
    )]
    Refused(String),
}
