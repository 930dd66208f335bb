//! AVEVA review files in their text form.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| trimaran_fuzz::models::rvm_text(bytes));
