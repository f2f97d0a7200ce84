use std::sync::{Arc, Mutex, PoisonError};

use relume_gpu::compare::Layers;
use relume_gpu::{Gpu, GpuError};

/// Pictures without the lights that are solved, and lights that stay. They are copied to whichever GPU is in use.
pub(crate) struct DeviceLayers {
    pictures: Vec<Vec<[f32; 3]>>,
    on_gpu: Mutex<Option<Arc<Layers>>>,
}

impl DeviceLayers {
    pub fn new(base: &[[f32; 3]], still: &[&[[f32; 3]]]) -> Self {
        let pictures = std::iter::once(&base).chain(still).map(|picture| picture.to_vec()).collect();
        Self { pictures, on_gpu: Mutex::default() }
    }

    pub fn on(&self, gpu: &Arc<Gpu>) -> Result<Arc<Layers>, GpuError> {
        let mut on_gpu = self.on_gpu.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(layers) = on_gpu.as_ref().filter(|layers| Arc::ptr_eq(layers.gpu(), gpu)) {
            return Ok(Arc::clone(layers));
        }
        let pictures: Vec<&[[f32; 3]]> = self.pictures.iter().map(Vec::as_slice).collect();
        let layers = Arc::new(Layers::new(gpu, &pictures)?);
        Ok(Arc::clone(on_gpu.insert(layers)))
    }
}
