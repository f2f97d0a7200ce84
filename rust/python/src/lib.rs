//! The native half of the Python module `relume`: translates and does nothing else.

mod array;
mod data_passes;
mod dicing;
mod error;
mod job;
mod live;
mod relighter;
mod scene;
mod scene_builder;
mod solve;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("RelumeError", module.py().get_type::<error::RelumeError>())?;
    module.add_function(wrap_pyfunction!(job::run_command_line, module)?)?;
    module.add_function(wrap_pyfunction!(job::start_command, module)?)?;
    module.add_function(wrap_pyfunction!(data_passes::matte_hash, module)?)?;
    module.add_function(wrap_pyfunction!(job::folder_in_use, module)?)?;
    module.add_function(wrap_pyfunction!(solve::solve, module)?)?;
    module.add_class::<job::PyJob>()?;
    module.add_class::<data_passes::PyDataPasses>()?;
    module.add_class::<live::PyBoard>()?;
    module.add_class::<live::PyLive>()?;
    module.add_class::<live::PyFrame>()?;
    module.add_class::<live::PyLight>()?;
    module.add_class::<live::PyLiveStatus>()?;
    module.add_class::<live::PyRequest>()?;
    module.add_class::<relighter::PyRelighter>()?;
    module.add_class::<scene_builder::PySceneBuilder>()?;
    module.add_class::<scene::PyWorld>()?;
    module.add_class::<scene::PyScene>()
}

/// Options for Windows' linker, read from this section. maturin exports the entry by the full name of the module alone;
/// Python looks for it by the last part.
#[cfg(all(windows, target_env = "gnu"))]
#[used]
#[unsafe(link_section = ".drectve")]
static ENTRY: [u8; 76] = *b" -export:PyInit__native -alternatename:PyInit_relume._native=PyInit__native ";
