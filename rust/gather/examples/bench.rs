//! Prints the figures of `relume_gather::bench`.
fn main() {
    let megabytes = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(256);
    for m in relume_gather::bench::measure(megabytes).expect("the made-up dump is sound") {
        println!("{:60} {:10.3} {} share {:.2?}", m.name, m.value, m.unit, m.share_of_limit());
    }
}
