//! Steps that a scene from a file of any bytes must stand.

use relume_dump::MemoryWriter;
use relume_session::scene::Scene;
use relume_trace::{Control, TraceSettings, Tracer};

/// Traces a few paths of a scene of few pixels, if it is one that the tracer takes.
pub fn trace(scene: &Scene) {
    let settings = TraceSettings { samples: 2, tile_size: 2, threads: 1, ..TraceSettings::default() };
    if let Ok(tracer) = Tracer::new(scene, &settings) {
        let sink = MemoryWriter::new(tracer.manifest()).expect("a valid manifest");
        tracer.trace(&sink, &Control::default()).expect("traced");
        assert_eq!(sink.snapshot().validate(), Vec::<String>::new());
    }
}
