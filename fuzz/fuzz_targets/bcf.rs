//! Notes of other programs.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    trimaran_fuzz::files::bcf(bytes);
});
