//! Prints the speed of the networks against the peak of one core:
//! `cargo run --release -p relume-proxy --example bench_kernels`

fn main() -> Result<(), relume_proxy::ProxyError> {
    for figure in relume_proxy::bench::kernels(relume_proxy::bench::Extent::CPU)? {
        println!("{figure}");
    }
    Ok(())
}
