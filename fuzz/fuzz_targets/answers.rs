//! The answers of a stranger to a peer that connects over byte streams.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    trimaran_fuzz::hellos::answers(bytes);
});
