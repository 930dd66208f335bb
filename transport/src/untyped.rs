//! Links whose protocol is known only at run time: for gateways, recorders and other languages.

use std::convert::Infallible;
use std::fmt;

use bytes::Bytes;
use serde::de::{SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trimaran_wire::{Fixed, FixedBytes, Format, MAX_FIXED, Protocol, ProtocolName};

use thiserror::Error;

/// A protocol of bytes, whose name and sizes stand in this side's [`UntypedHello`]. Its peers may have the
/// types: a link needs only the same name and sizes.
///
/// An item is a byte here, so push as many as an item on the wire has, or a multiple of that.
///
/// ```
/// use trimaran_transport::untyped::{Raw, Untyped, UntypedHello};
/// use trimaran_transport::{Endpoint, Instant, Net, Options, connect};
///
/// # async fn show(
/// #     net: std::sync::Arc<dyn Net>, there: Endpoint, by: Instant,
/// # ) -> Result<(), Box<dyn std::error::Error>> {
/// // The protocol of the README: poses and points of 12 bytes. Its hello is a name and the number of a map.
/// let hello = UntypedHello::new("robot/1", 12, 12, 12, Raw::from(&b"\x05panel\x07"[..]))?;
/// let mut link = connect::<Untyped>(&net, &there, hello, &Options::default(), by).await?;
/// link.latest_tx.publish([0; 12].into())?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Untyped;

/// This side's protocol, and its hello in the protocol's own encoding. Of a peer's hello only that is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UntypedHello {
    /// The hello, as serde's postcard encodes it.
    pub bytes: Raw,
    spoken: Option<Spoken>,
}

/// The protocol of this side.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Spoken {
    name: ProtocolName,
    latest: usize,
    header: usize,
    item: usize,
}

/// Why there is no such protocol.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum UntypedError {
    /// Its name.
    #[error("{0:?} is no name of a protocol: give 1 to {most} bytes", most = ProtocolName::MAX_BYTES)]
    Name(String),
    /// The size of a value or a header.
    #[error("a {kind} of {bytes} bytes is too long: at most {MAX_FIXED} are allowed")]
    Value {
        /// A value of the latest lane, or a header.
        kind: &'static str,
        /// Its size.
        bytes: usize,
    },
    /// The size of an item.
    #[error("an item of {0} bytes is outside 1 to 256")]
    Item(usize),
}

impl UntypedHello {
    /// The hello of a side that speaks the protocol `name`, whose values, headers and items have these sizes
    /// in bytes.
    ///
    /// # Errors
    /// If the name or a size is not allowed.
    pub fn new(
        name: &str,
        latest: usize,
        header: usize,
        item: usize,
        bytes: Raw,
    ) -> Result<Self, UntypedError> {
        if name.is_empty() || name.len() > ProtocolName::MAX_BYTES {
            return Err(UntypedError::Name(name.to_owned()));
        }
        for (kind, bytes) in [("value", latest), ("header", header)] {
            if bytes > MAX_FIXED {
                return Err(UntypedError::Value { kind, bytes });
            }
        }
        if !(1..=256).contains(&item) {
            return Err(UntypedError::Item(item));
        }
        Ok(Self { bytes, spoken: Some(Spoken { name: ProtocolName::new(name), latest, header, item }) })
    }

    /// The sizes, also for [`Publisher::of_format`](crate::Publisher::of_format).
    #[must_use]
    pub fn format(&self) -> Format {
        self.spoken.as_ref().map_or_else(Format::default, |spoken| {
            let Spoken { latest, header, item, .. } = *spoken;
            Format { latest, header, item, ..Format::default() }
        })
    }
}

impl Serialize for UntypedHello {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.bytes.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for UntypedHello {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Raw::deserialize(deserializer).map(|bytes| Self { bytes, spoken: None })
    }
}

impl Protocol for Untyped {
    const NAME: &'static str = "";
    type Hello = UntypedHello;
    type Latest = RawValue;
    type Header = RawValue;
    type Item = u8;
    type Message = Raw;

    /// The text with which the hello begins, as in a struct whose first field is a `String`; else `the peer`.
    fn name(hello: &UntypedHello) -> String {
        let text = hello.bytes.split_first().and_then(|(length, rest)| rest.get(..usize::from(*length)));
        let text = text.filter(|text| text.len() < 128).and_then(|text| str::from_utf8(text).ok());
        let printable = |text: &&str| !text.is_empty() && !text.contains(char::is_control);
        text.filter(printable).unwrap_or("the peer").to_owned()
    }

    fn protocol(ours: &UntypedHello) -> ProtocolName {
        ours.spoken.as_ref().map_or_else(|| ProtocolName::new(Self::NAME), |spoken| spoken.name.clone())
    }

    fn format(ours: &UntypedHello) -> Format {
        ours.format()
    }
}

/// A value or a header: its bytes. Within a process nobody checks that it has the protocol's size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawValue(pub FixedBytes);

impl<const N: usize> From<[u8; N]> for RawValue {
    fn from(bytes: [u8; N]) -> Self {
        Self(bytes.as_slice().into())
    }
}

impl From<&[u8]> for RawValue {
    fn from(bytes: &[u8]) -> Self {
        Self(bytes.into())
    }
}

impl Fixed for RawValue {
    /// Known only at run time.
    const SIZE: usize = 0;
    type Error = Infallible;

    fn write(&self, out: &mut [u8]) {
        for (out, byte) in out.iter_mut().zip(&self.0) {
            *out = *byte;
        }
    }

    fn read(bytes: &[u8]) -> Result<Self, Infallible> {
        Ok(bytes.into())
    }

    fn to_bytes(&self) -> FixedBytes {
        self.0.clone()
    }
}

/// A hello or a message in its encoding: on the wire it stands as it is, without a length.
#[derive(Clone, PartialEq, Eq, Default)]
pub struct Raw(Bytes);

impl From<Bytes> for Raw {
    fn from(bytes: Bytes) -> Self {
        Self(bytes)
    }
}

impl From<&[u8]> for Raw {
    fn from(bytes: &[u8]) -> Self {
        Self(Bytes::copy_from_slice(bytes))
    }
}

impl std::ops::Deref for Raw {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}

impl fmt::Debug for Raw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Serialize for Raw {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = serializer.serialize_tuple(self.0.len())?;
        self.0.iter().try_for_each(|byte| bytes.serialize_element(byte))?;
        bytes.end()
    }
}

impl<'de> Deserialize<'de> for Raw {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_tuple(usize::MAX, All)
    }
}

/// Reads bytes to the end.
struct All;

impl<'de> Visitor<'de> for All {
    type Value = Raw;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("bytes")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<Raw, A::Error> {
        let mut all = Vec::new();
        // Any byte is valid, so only the end is an error.
        while let Ok(Some(byte)) = bytes.next_element() {
            all.push(byte);
        }
        Ok(Raw(all.into()))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

    use proptest::prelude::*;

    use super::*;
    use crate::application::whole;

    proptest! {
        #[test]
        fn bytes_stand_on_the_wire_as_they_are(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let raw = Raw::from(&bytes[..]);
            prop_assert_eq!(&postcard::to_stdvec(&raw).unwrap(), &bytes);
            prop_assert_eq!(whole::<Raw>(&bytes).unwrap(), raw);
        }
    }

    #[test]
    fn the_text_at_the_begin_of_a_hello_is_the_name() {
        let name = |bytes: &[u8]| Untyped::name(&whole(bytes).unwrap());
        assert_eq!(name(b"\x05panel\x07"), "panel");
        for other in [&b""[..], b"\0", b"\x05pane", b"\x02\xff\xff", b"\x02a\n"] {
            assert_eq!(name(other), "the peer", "{other:?}");
        }
    }

    #[test]
    fn names_and_sizes_have_limits() {
        let of = |name: &str, latest, header, item| {
            UntypedHello::new(name, latest, header, item, Raw::default()).map_err(|e| e.to_string())
        };
        assert!(of("robot/1", 1024, 1024, 256).is_ok() && of(&"n".repeat(32), 0, 0, 1).is_ok());
        for (hello, error) in [
            (of("", 0, 0, 1), "\"\" is no name of a protocol: give 1 to 32 bytes"),
            (of("robot/1", 1025, 0, 1), "a value of 1025 bytes is too long: at most 1024 are allowed"),
            (of("robot/1", 0, 1025, 1), "a header of 1025 bytes is too long: at most 1024 are allowed"),
            (of("robot/1", 0, 0, 0), "an item of 0 bytes is outside 1 to 256"),
            (of("robot/1", 0, 0, 257), "an item of 257 bytes is outside 1 to 256"),
        ] {
            assert_eq!(hello.unwrap_err(), error);
        }
        assert!(of(&"n".repeat(33), 0, 0, 1).is_err());
    }
}
