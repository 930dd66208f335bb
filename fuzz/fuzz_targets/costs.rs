//! Packets of a peer that wants each byte to cost much.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::costs::costs(bytes));
