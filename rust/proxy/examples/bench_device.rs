//! Prints the speed of the networks on the best GPU against its peak of multiply-adds:
//! `cargo run --release -p relume-proxy --example bench_device`

use relume_gpu::{Gpu, GpuChoice};
use relume_proxy::bench::Extent;

fn main() -> Result<(), relume_proxy::ProxyError> {
    let gpu = Gpu::shared(&GpuChoice::Best)?;
    println!("{}", gpu.summary().name);
    let extent = if gpu.summary().software { Extent::SOFTWARE } else { Extent::CARD };
    for figure in relume_proxy::bench::device(&gpu, extent)? {
        println!("{figure}");
    }
    Ok(())
}
