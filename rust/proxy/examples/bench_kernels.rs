//! Prints the speed of the networks against the peak of one core:
//! `cargo run --release -p relume-proxy --example bench_kernels`

fn main() -> Result<(), relume_proxy::ProxyError> {
    for record in relume_proxy::bench::kernels(relume_proxy::bench::Extent::CPU)? {
        println!(
            "{:48} {:8.3} M {} of {:8.3} M possible: {:5.1} %",
            record.name,
            record.value * 1e-6,
            record.unit,
            record.limit * 1e-6,
            100.0 * record.share_of_limit,
        );
    }
    Ok(())
}
