//! The messages of roles: codecs, the published examples, the dissector.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[allow(unreachable_pub, dead_code, reason = "the fuzz targets share the file, and see all of it as public")]
#[path = "../../../fuzz/src/checks.rs"]
mod checks;
#[path = "../../../transport/wire/tests/all/examples/mod.rs"]
mod examples;

mod codec;
mod dissector;
mod supply;
mod walkthrough;
mod wire;
