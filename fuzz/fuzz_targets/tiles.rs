//! Tiles of solid space, from a service.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::files::tiles(bytes));
