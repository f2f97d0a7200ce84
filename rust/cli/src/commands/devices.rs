use crate::console::Console;
use relume_session::gpu::{AdapterSummary, adapters};
use serde::Serialize;

#[derive(Serialize)]
struct Devices {
    devices: Vec<Listed>,
}

#[derive(Serialize)]
struct Listed {
    name: String,
    backend: String,
    driver: String,
    pci_bus_id: String,
    software: bool,
}

/// Lists the GPUs, the best first.
pub fn devices(console: &Console) -> anyhow::Result<()> {
    let found = adapters();
    let lines: Vec<String> = found.iter().map(line).collect();
    let text = if lines.is_empty() {
        "no GPU was found; everything runs on the CPU".into()
    } else {
        lines.join("\n")
    };
    let listed = |found: AdapterSummary| Listed {
        name: found.name,
        backend: found.backend,
        driver: found.driver,
        pci_bus_id: found.pci_bus_id,
        software: found.software,
    };
    console.result(&text, &Devices { devices: found.into_iter().map(listed).collect() });
    Ok(())
}

fn line(found: &AdapterSummary) -> String {
    let software = if found.software { ", in software: slower than --device cpu" } else { "" };
    format!("{} ({}, {}{software})", found.title(), found.backend, found.driver)
}
