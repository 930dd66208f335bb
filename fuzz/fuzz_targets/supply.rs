//! Blocks of the bulk lane, from a display or a culler.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::supply::supply(bytes));
