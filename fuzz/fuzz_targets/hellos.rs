//! The bytes of a stranger to a listener over byte streams.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    trimaran_fuzz::hellos::hellos(bytes);
});
