//! Large arrays in huge pages: rays jump around in them, and with pages of 4 KiB each jump also misses the table of
//! pages (TLB).

use std::ops::Deref;

use bytemuck::Pod;
use memmap2::MmapMut;

/// Arrays below this size gain nothing.
const HUGE_FROM_BYTES: usize = 4 << 20;

/// A read-only array.
#[derive(Debug)]
pub(super) enum Storage<T> {
    /// Memory on the heap.
    Heap(Vec<T>),
    /// Memory of its own for which huge pages were asked.
    Mapped(MmapMut),
}

impl<T: Pod> Storage<T> {
    /// Takes the values; they stay on the heap if they are few or the system gives no memory map.
    pub fn new(values: Vec<T>) -> Self {
        let bytes: &[u8] = bytemuck::cast_slice(&values);
        if bytes.len() < HUGE_FROM_BYTES {
            return Self::Heap(values);
        }
        let Ok(mut map) = MmapMut::map_anon(bytes.len()) else { return Self::Heap(values) };
        // Without huge pages the map is as good as the heap.
        #[cfg(target_os = "linux")]
        let _ = map.advise(memmap2::Advice::HugePage);
        map.copy_from_slice(bytes);
        Self::Mapped(map)
    }
}

impl<T: Pod> Default for Storage<T> {
    fn default() -> Self {
        Self::Heap(Vec::new())
    }
}

impl<T: Pod> Deref for Storage<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Self::Heap(values) => values,
            Self::Mapped(map) => bytemuck::cast_slice(map),
        }
    }
}
