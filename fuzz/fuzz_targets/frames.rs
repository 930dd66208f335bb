//! Sequences of begin, push, flush and finish.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::checks::frames(bytes));
