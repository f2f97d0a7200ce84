//! A proxy or training checkpoint of any bytes is refused or opens; it never panics.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    relume_proxy::fuzz_open(bytes);
});
