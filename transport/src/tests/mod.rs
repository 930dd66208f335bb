//! Tests of transports from the inside that need the modules above them as well.

#[cfg(feature = "tcp")]
mod pipes;
#[cfg(feature = "quic")]
mod quic_lies;
