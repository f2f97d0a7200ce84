//! A request of any text, for lights or for a picture, is refused or solved on a tiny bake; it never panics.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_session::image::Image;
use relume_session::live::LiveRequest;
use relume_session::{Monitor, Pictures, Relighter, SolveRequest, solve_lights};
use std::collections::HashMap;
use std::path::Path;
use std::sync::LazyLock;

static BAKE: LazyLock<Relighter> = LazyLock::new(|| {
    let bake = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/bake");
    Relighter::open(&bake).expect("seeds, as scripts/fuzz makes them")
});

fuzz_target!(|text: &str| {
    drop(LiveRequest::parse(text));
    drop(LiveRequest::parse_for(text, "Wide"));
    let Ok(mut request) = SolveRequest::parse(text) else { return };
    // Requests may rightly take long, so their options are cut.
    let options = &mut request.options;
    (options.starts, options.candidates) = (options.starts.min(2), options.candidates.min(2));
    (options.steps, options.polish) = (options.steps.min(2), options.polish.min(1));
    if request.now.lights.len() + options.add.map_or(0, |add| add.count) > 4 {
        return;
    }
    let grey = |value: f32| Image { data: vec![value; 48], ..Image::new(4, 4, 3) };
    let named = HashMap::from([("target".into(), grey(0.3)), ("mask".into(), grey(1.0))]);
    drop(solve_lights(&[&*BAKE], &request, &Pictures::named(named), &Monitor::default(), &|_| ()));
});
