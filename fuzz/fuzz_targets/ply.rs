//! PLY files.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::models::ply(bytes));
