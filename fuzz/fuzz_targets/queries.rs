//! Queries of a page's user.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::files::queries(bytes));
