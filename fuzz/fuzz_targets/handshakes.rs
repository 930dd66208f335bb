//! A handshake, and a stranger beside it.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::handshakes::handshakes(bytes));
