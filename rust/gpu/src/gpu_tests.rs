use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::*;

/// Any device will do, a software driver included; that there is none is a failure.
pub(crate) fn gpu() -> std::sync::Arc<Gpu> {
    Gpu::open(&GpuChoice::Best)
        .expect("tests need a GPU or a software driver, like Debian's mesa-vulkan-drivers")
}

/// All files in a folder and those in it.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let (mut folders, mut files) = (vec![folder.to_owned()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files
}

#[test]
fn every_wgsl_file_is_embedded_and_valid() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shaders");
    let name = |path: PathBuf| {
        path.strip_prefix(&root).unwrap().with_extension("").to_str().unwrap().replace('\\', "/")
    };
    let mut found: Vec<_> = files_below(&root).into_iter().map(name).collect();
    found.sort();
    let mut embedded: Vec<_> = modules::FILES.iter().map(|(name, _)| (*name).to_owned()).collect();
    embedded.sort();
    assert_eq!(embedded, found);
    for name in embedded {
        modules::validate(&name, &[]).unwrap_or_else(|error| panic!("{error}"));
    }
}

/// The structs that a module takes from Rust, as arguments or in buffers, by name.
fn structs_from_rust(module: &naga::Module) -> BTreeSet<String> {
    use naga::{AddressSpace, TypeInner};
    let is_shared = |space: AddressSpace| {
        matches!(space, AddressSpace::Immediate | AddressSpace::Uniform | AddressSpace::Storage { .. })
    };
    let variables = module.global_variables.iter().filter(|(_, variable)| is_shared(variable.space));
    let mut types: Vec<_> = variables.map(|(_, variable)| variable.ty).collect();
    let mut found = BTreeSet::new();
    while let Some(ty) = types.pop() {
        match &module.types[ty].inner {
            TypeInner::Array { base, .. } => types.push(*base),
            TypeInner::Struct { members, .. } => {
                found.extend(module.types[ty].name.clone());
                types.extend(members.iter().map(|member| member.ty));
            }
            _ => {}
        }
    }
    found
}

/// File and name of what `assert_mirror!` is called for in a Rust source.
fn compared_in(source: &str) -> impl Iterator<Item = (String, String)> + '_ {
    source.split("assert_mirror!(").skip(1).filter_map(|call| {
        let mut quoted = call.split('"').skip(1).step_by(2);
        Some((quoted.next()?.to_owned(), quoted.next()?.to_owned()))
    })
}

#[test]
fn every_struct_that_comes_from_rust_is_compared_with_its_mirror() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut compared = BTreeSet::new();
    for name in ["gpu", "gather", "proxy"] {
        for path in files_below(&crates.join(name).join("src")) {
            compared.extend(compared_in(&std::fs::read_to_string(path).unwrap()));
        }
    }
    let mut missing = BTreeSet::new();
    for (name, _) in modules::FILES {
        let text = modules::compose(name, &[]).unwrap();
        let structs = structs_from_rust(&modules::validate(name, &[]).unwrap());
        for of_rust in structs {
            let declares = |(file, of_file): &&(&str, &str)| {
                text.contains(&format!("// {file}.wgsl\n"))
                    && of_file.contains(&format!("struct {of_rust} {{"))
            };
            let (file, _) = modules::FILES.iter().find(declares).expect("a file that declares it");
            missing.insert(((*file).to_owned(), of_rust));
        }
    }
    assert!(missing.len() > 30, "{missing:?}");
    missing.retain(|of_rust| !compared.contains(of_rust));
    assert!(missing.is_empty(), "assert_mirror! is missing for {missing:?}");
}

#[test]
fn a_kernel_adds_up_a_buffer() {
    let gpu = gpu();
    println!("on {:?}", gpu.summary());
    let values: Vec<u32> = (0..100_000).collect();
    let (input, total) = (gpu.buffer_of("values", &values).unwrap(), gpu.zeros::<u32>("total", 1).unwrap());
    let kernel = gpu.kernel("selftest", "sum", &[("GROUP_SIZE", 32)]).unwrap();
    let bound = kernel.bind(&[input.whole(), total.whole()]).unwrap();
    let mut commands = gpu.commands("sum");
    commands.run(&bound, 100_000 / 32 + 1, &[]);
    commands.submit().unwrap();
    assert_eq!(gpu.read(&total, 0..1).unwrap(), [values.iter().fold(0u32, |sum, &v| sum.wrapping_add(v))]);
}

#[test]
fn a_kernel_is_compiled_once_a_device() {
    let (gpu, other) = (gpu(), gpu());
    let kernel = |gpu: &Gpu, module: &str, entry: &str, size: u32| {
        gpu.kernel(module, entry, &[("GROUP_SIZE", size)]).unwrap().pipeline
    };
    let first = kernel(&gpu, "selftest", "sum", 32);
    assert_eq!(kernel(&gpu, "selftest", "sum", 32), first);
    assert_ne!(kernel(&gpu, "selftest", "sum", 64), first);
    assert_ne!(kernel(&other, "selftest", "sum", 32), first);
    // The entry points of a module are kernels of their own.
    let muon = |entry: &str| gpu.kernel("train/muon", entry, &[]).unwrap().pipeline;
    let [one, another] = ["start", "finish"].map(muon);
    assert_ne!(one, another);
}

/// Reads an array behind its end: a kernel that checks its indices takes the last value.
const BEHIND_THE_END: &str = "
    @group(0) @binding(0) var<storage, read_write> values: array<u32>;
    var<private> four: array<u32, 4>;
    @compute @workgroup_size(1)
    fn read() {
        four[3] = 7u;
        values[0] = four[values[0]];
    }
";

#[test]
fn twins_of_a_gpu_compile_kernels_with_checks_and_without() {
    let gpu = gpu();
    let [checked, unchecked] = [Checks::On, Checks::Off].map(|checks| gpu.open_second(checks).unwrap());
    assert_eq!([&checked, &unchecked].map(|second| second.summary()), [gpu.summary(); 2]);
    assert_eq!([&checked, &unchecked].map(|second| second.checks()), [Checks::On, Checks::Off]);
    for gpu in [&checked, &unchecked] {
        let (values, total) =
            (gpu.buffer_of("values", &[1u32, 2, 3]).unwrap(), gpu.zeros::<u32>("total", 1).unwrap());
        let kernel = gpu.kernel("selftest", "sum", &[]).unwrap();
        let mut commands = gpu.commands("sum");
        commands.run(&kernel.bind(&[values.whole(), total.whole()]).unwrap(), 1, &[]);
        commands.submit().unwrap();
        assert_eq!(gpu.read(&total, 0..1).unwrap(), [6]);
    }
    let values = checked.buffer_of("values", &[1000u32]).unwrap();
    let kernel = checked.kernel_of_text("behind the end", BEHIND_THE_END, "read").unwrap();
    let mut commands = checked.commands("read");
    commands.run(&kernel.bind(&[values.whole()]).unwrap(), 1, &[]);
    commands.submit().unwrap();
    assert_eq!(checked.read(&values, 0..1).unwrap(), [7]);
}

#[test]
fn a_buffer_above_the_limit_of_the_driver_is_refused_by_name() {
    let gpu = gpu();
    gpu.set_memory_budget(Some(u64::MAX));
    let most = gpu.limits().buffer;
    let error = gpu.zeros::<u8>("positions", most as usize + 1).unwrap_err();
    assert_eq!(error, GpuError::TooLarge { what: "positions".into(), limit: most >> 20 });
    assert!(error.to_string().contains("positions is larger than a buffer of this GPU can be ("), "{error}");
    assert!(error.to_string().contains("--device cpu"));
    gpu.check().unwrap();
}

#[test]
fn many_workgroups_are_folded_into_rows() {
    for groups in [0, 1, 65_535, 65_536, 442_500, 10_000_000] {
        let [x, y] = fold(groups);
        assert!(
            x <= 65_535 && y <= 65_535 && x * y >= groups && x * y < groups + y.max(1),
            "{groups}: {x} x {y}"
        );
    }
}

#[test]
fn buffers_count_against_the_budget_until_they_are_dropped() {
    let gpu = gpu();
    gpu.set_memory_budget(Some(1 << 20));
    let first = gpu.zeros::<f32>("first", 200_000).unwrap();
    let error = gpu.zeros::<f32>("second", 100_000).unwrap_err();
    assert_eq!(error, GpuError::OutOfMemory { what: "second".into(), needed: 1, free: 0 });
    drop(first);
    assert_eq!(gpu.free_memory(), 1 << 20);
    gpu.zeros::<f32>("second", 100_000).unwrap();
}

#[test]
fn without_a_budget_of_the_user_what_the_driver_says_counts_again() {
    let gpu = gpu();
    assert!(gpu.free_memory() > 1 << 20);
    gpu.set_memory_budget(Some(1 << 20));
    assert_eq!(gpu.free_memory(), 1 << 20);
    gpu.set_memory_budget(None);
    assert!(gpu.free_memory() > 1 << 20);
}

#[test]
fn a_lost_device_says_so_and_is_replaced() {
    let gpu = Gpu::shared(&GpuChoice::Best).unwrap();
    assert!(std::sync::Arc::ptr_eq(&gpu, &Gpu::shared(&GpuChoice::Best).unwrap()));
    // Another word for the same GPU.
    let name = GpuChoice::Named(adapters()[0].name.clone());
    assert!(std::sync::Arc::ptr_eq(&gpu, &Gpu::shared(&name).unwrap()));
    // What was refused is told to whoever asks for it, and no reason for another device.
    let unusable = wgpu::BufferUsages::empty();
    let label = Some("for nothing");
    let _ = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label,
        size: 4,
        usage: unusable,
        mapped_at_creation: false,
    });
    assert!(std::sync::Arc::ptr_eq(&gpu, &Gpu::shared(&GpuChoice::Best).unwrap()));
    assert!(matches!(gpu.check(), Err(GpuError::Refused(_))));
    let buffer = gpu.buffer_of("values", &[1u32, 2]).unwrap();
    gpu.lose();
    assert!(matches!(gpu.read(&buffer, 0..2), Err(GpuError::Lost(_))));
    assert!(matches!(gpu.zeros::<u32>("more", 1), Err(GpuError::Lost(_))));
    let again = Gpu::shared(&GpuChoice::Best).unwrap();
    let buffer = again.buffer_of("values", &[1u32, 2]).unwrap();
    assert_eq!(again.read(&buffer, 0..2).unwrap(), [1, 2]);
}

#[test]
fn unknown_names_are_answered_with_those_that_there_are() {
    let error = Gpu::open(&GpuChoice::Named("no such card".into())).unwrap_err().to_string();
    assert!(error.contains("no such card") && error.contains(&adapters()[0].name), "{error}");
    let name = adapters()[0].name.to_uppercase();
    assert_eq!(Gpu::open(&GpuChoice::Named(name)).unwrap().summary(), &adapters()[0]);
}

#[test]
fn cards_of_one_name_are_told_apart_by_where_they_are() {
    let card = |pci_bus_id: &str| AdapterSummary {
        name: "NVIDIA RTX 4090".into(),
        backend: "Vulkan".into(),
        driver: "NVIDIA".into(),
        pci_bus_id: pci_bus_id.into(),
        software: false,
    };
    let [one, other] = ["0000:01:00.0", "0000:A1:00.0"].map(card);
    assert!(one.is_called("rtx") && other.is_called("rtx"));
    assert!(!one.is_called("0000:a1:00.0") && other.is_called("0000:a1:00.0"));
    // A part of a place is no name.
    assert!(!one.is_called("01:00"));
    assert_eq!(one.title(), "NVIDIA RTX 4090 at 0000:01:00.0");
    assert_eq!(card("").title(), "NVIDIA RTX 4090");
    assert!(other.is_called(&other.title()) && !one.is_called(&other.title()));
}

#[test]
fn a_card_without_a_driver_is_told_from_no_card() {
    assert_eq!(choice::nothing_found(Some(true)), GpuError::NoDriver);
    // Where the system cannot be asked, most likely there is none.
    assert_eq!([Some(false), None].map(choice::nothing_found), [GpuError::NoAdapter, GpuError::NoAdapter]);
}

#[test]
fn memory_that_ran_out_unasked_is_no_mistake_of_ours() {
    let out = device::uncaptured(&wgpu::Error::OutOfMemory { source: "staging".into() });
    assert_eq!(out, GpuError::DriverOutOfMemory("staging".into()));
    assert!(!out.to_string().contains("report") && out.to_string().contains("memory"), "{out}");
    let (source, description) = ("it".into(), "it".into());
    let refused = device::uncaptured(&wgpu::Error::Validation { source, description });
    assert!(matches!(refused, GpuError::Refused(_)));
}

#[test]
fn wrong_buffers_and_modules_are_errors() {
    let gpu = gpu();
    let values = gpu.zeros::<u32>("values", 4).unwrap();
    let kernel = gpu.kernel("selftest", "sum", &[]).unwrap();
    assert!(matches!(kernel.bind(&[values.whole()]), Err(GpuError::Refused(_))));
    assert!(matches!(gpu.kernel("selftest", "product", &[]), Err(GpuError::Shader { .. })));
    assert!(matches!(gpu.kernel("no such", "sum", &[]), Err(GpuError::Shader { .. })));
    assert!(matches!(gpu.kernel("selftest", "sum", &[("SIZE", 1)]), Err(GpuError::Shader { .. })));
    gpu.check().unwrap();
}

#[test]
fn timers_measure_on_the_device() {
    let gpu = gpu();
    let Some(mut timer) = gpu.timer(3).unwrap() else {
        assert!(std::env::var_os("CI").is_none(), "{} has no clock", gpu.summary().name);
        return println!("skipped: {} has no clock", gpu.summary().name);
    };
    let (values, total) =
        (gpu.zeros::<u32>("values", 1 << 20).unwrap(), gpu.zeros::<u32>("total", 1).unwrap());
    let bound = gpu.kernel("selftest", "sum", &[]).unwrap().bind(&[values.whole(), total.whole()]).unwrap();
    let mut commands = gpu.commands("timed");
    commands.mark(&mut timer);
    commands.run(&bound, 1, &[]);
    commands.mark(&mut timer);
    commands.run(&bound, (1 << 20) / 64, &[]);
    commands.mark(&mut timer);
    commands.submit().unwrap();
    let seconds = timer.seconds(&gpu).unwrap();
    assert!(seconds.len() == 2 && seconds.iter().all(|&s| (0.0..60.0).contains(&s)), "{seconds:?}");
}

#[test]
fn a_driver_without_what_kernels_need_is_refused_by_name() {
    let whole = wgpu::Features::IMMEDIATES;
    let good = gpu().device.limits();
    assert_eq!(device::missing(whole, &good), None);
    assert!(device::missing(wgpu::Features::empty(), &good).unwrap().contains("push constants"));
    let few = wgpu::Limits { max_storage_buffers_per_shader_stage: 8, ..good.clone() };
    assert_eq!(device::missing(whole, &few).unwrap(), "its driver has 8 buffers of a kernel, 12 are needed");
    let small = wgpu::Limits { max_compute_workgroup_storage_size: 16 << 10, ..good };
    assert!(device::missing(whole, &small).unwrap().contains("workgroup memory"));
}

#[test]
fn properties_are_those_of_the_driver() {
    let gpu = gpu();
    let properties = gpu.properties();
    let value =
        |name: &str| properties.iter().find(|p| p.name == name).unwrap_or_else(|| panic!("no {name}")).value;
    assert_eq!(value("bytes of a buffer that can be bound"), gpu.limits().buffer as f64);
    assert_eq!(value("16-bit floats in kernels"), f64::from(u8::from(gpu.limits().f16)));
    assert_eq!(value("bytes that our buffers may take"), gpu.free_memory() as f64);
}

#[test]
fn a_constant_chooses_between_files() {
    let text = |constants: &[_]| modules::compose("train/weights", constants);
    assert!(!text(&[]).unwrap().contains("coopLoad"));
    assert!(text(&[("MATRICES", 1)]).unwrap().contains("coopLoad"));
    let error = text(&[("MATRICES", 2)]).unwrap_err().to_string();
    assert!(error.contains("MATRICES") && error.contains("has no choice 2"), "{error}");
}

fn valid(name: &str, constants: &[(&str, u32)]) -> (naga::Module, naga::valid::ModuleInfo) {
    let module = modules::validate(name, constants).unwrap_or_else(|error| panic!("{error}"));
    let (flags, capabilities) = (naga::valid::ValidationFlags::all(), naga::valid::Capabilities::all());
    let info = naga::valid::Validator::new(flags, capabilities).validate(&module).unwrap();
    (module, info)
}

/// Modules that multiply by matrices, with the constants of these.
fn by_matrices(side: u32, subgroup: u32) -> Vec<(&'static str, Vec<(&'static str, u32)>)> {
    let of_matrices = Matrices { side, subgroup }.constants();
    let alone = ["subgroup", "proxy/matrices"].map(|name| (name, of_matrices.to_vec()));
    let train = ["train/chains", "train/loss", "train/weights"];
    let train = train.map(|name| (name, [&[("MATRICES", 1)][..], &of_matrices].concat()));
    alone.into_iter().chain(train).collect()
}

/// Not every driver has cooperative matrices, and the compiler was seen to give up on such modules only when it writes them.
#[test]
fn every_entry_point_can_be_written_as_spirv() {
    let mut entries = 0;
    let of_files = modules::FILES.iter().map(|(name, _)| (*name, Vec::new()));
    // NVIDIA's, AMD's and those of Mesa's software.
    let of_matrices =
        [(16, 32), (16, 64), (8, 8)].into_iter().flat_map(|(side, subgroup)| by_matrices(side, subgroup));
    for (name, constants) in of_files.chain(of_matrices) {
        let (module, info) = valid(name, &constants);
        for entry in &module.entry_points {
            let options =
                naga::back::spv::Options { lang_version: (1, 6), ..naga::back::spv::Options::default() };
            let pipeline = naga::back::spv::PipelineOptions {
                shader_stage: entry.stage,
                entry_point: entry.name.clone(),
            };
            let words = naga::back::spv::write_vec(&module, &info, &options, Some(&pipeline));
            assert!(words.unwrap_or_else(|error| panic!("{name}: {error}")).len() > 100);
            entries += 1;
        }
    }
    assert!(entries > 10, "{entries}");
}

/// Metal's language, which has small matrices, and DirectX's, which has none.
#[test]
fn every_module_can_be_written_for_metal_and_directx() {
    use naga::back::{hlsl, msl};
    let mut written = 0;
    let by_matrices = by_matrices(8, 32);
    let has_matrices =
        |name: &str| by_matrices.iter().any(|(of, constants)| *of == name && constants.len() == 2);
    let plain =
        modules::FILES.iter().map(|(name, _)| (*name, Vec::new())).filter(|(name, _)| !has_matrices(name));
    for (name, constants) in plain.chain(by_matrices.clone()) {
        let (module, info) = valid(name, &constants);
        if module.entry_points.is_empty() {
            continue;
        }
        let metal =
            msl::Options { lang_version: (2, 4), fake_missing_bindings: true, ..msl::Options::default() };
        let of_metal = msl::write_string(&module, &info, &metal, &msl::PipelineOptions::default());
        assert!(of_metal.is_ok(), "{name} for Metal: {of_metal:?}");
        written += 1;
        if !constants.is_empty() {
            continue;
        }
        let directx = hlsl::Options {
            shader_model: hlsl::ShaderModel::V6_2,
            fake_missing_bindings: true,
            immediates_target: Some(hlsl::BindTarget::default()),
            ..hlsl::Options::default()
        };
        let mut text = String::new();
        let pipeline = hlsl::PipelineOptions::default();
        let of_directx = hlsl::Writer::new(&mut text, &directx, &pipeline).write(&module, &info, None);
        assert!(of_directx.is_ok(), "{name} for DirectX: {of_directx:?}");
    }
    assert!(written > 20, "{written}");
}

#[test]
fn discrete_cards_come_first_and_software_last() {
    use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu};
    let mut types = [Cpu, Other, IntegratedGpu, VirtualGpu, DiscreteGpu];
    types.sort_by_key(|device_type| choice::rank(*device_type));
    assert_eq!(types, [DiscreteGpu, IntegratedGpu, VirtualGpu, Other, Cpu]);
}
