//! The framed protocol without any network: codecs, frames, the published examples.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod examples;
mod robot;

mod refusals;

mod codec;
mod decoder;
mod frames;
mod wire;
