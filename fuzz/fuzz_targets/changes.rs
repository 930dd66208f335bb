//! Ids as changes, from a peer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::walkthrough::changes(bytes));
