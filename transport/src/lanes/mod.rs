//! The lanes of a link as the application uses them, over any transport.

/// Half a lane over one of the transports that carry bytes: `over_bytes!(Name: Half)`, where each of the
/// modules `stream`, `quic` and `udp` has its `Half`.
macro_rules! over_bytes {
    ($name:ident: $half:ident) => {
        #[derive(Debug)]
        #[allow(clippy::large_enum_variant, reason = "a link has one of each, for as long as it lives")]
        pub(crate) enum $name {
            Stream(stream::$half),
            #[cfg(feature = "quic")]
            Quic(quic::$half),
            #[cfg(feature = "udp")]
            Udp(udp::$half),
        }
    };
}

/// Applies the same code to such a half of any transport.
macro_rules! whichever {
    ($name:ident: $half:expr, $lane:ident => $act:expr) => {
        match $half {
            $name::Stream($lane) => $act,
            #[cfg(feature = "quic")]
            $name::Quic($lane) => $act,
            #[cfg(feature = "udp")]
            $name::Udp($lane) => $act,
        }
    };
}

pub(crate) mod bulk;
pub(crate) mod frames;
pub(crate) mod latest;
pub(crate) mod messages;
pub(crate) mod records;
pub(crate) mod shared;
