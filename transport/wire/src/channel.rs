//! Channels: further lanes of a link, each with a name and types of its own.

use std::any::{TypeId, type_name};
use std::fmt;

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{Fixed, MAX_FIXED, Text};

/// The most channels of a protocol.
pub const MAX_CHANNELS: usize = 16;

/// The name of a channel, as a peer sends it.
pub type ChannelName = Text<32>;

/// The number of a channel: its place in [`Protocol::CHANNELS`](crate::Protocol::CHANNELS), from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(transparent)]
pub struct ChannelNumber(pub u8);

impl ChannelNumber {
    /// Its place in a list of all channels.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// Reads the number of items that a coded batch claims; `None` if it is invalid.
pub type CountCoded = fn(&[u8]) -> Option<usize>;

/// A channel of a protocol: one more latest lane or frames lane, with types of its own.
///
/// Channels are independent: each has its own cell, or its own order of frames and its own backpressure.
///
/// ```
/// use trimaran_wire::Channel;
///
/// const CHANNELS: &[Channel] = &[Channel::latest::<()>("alive"), Channel::frames::<(), u32>("cells")];
/// assert_eq!(CHANNELS[1].name(), "cells");
/// assert!(CHANNELS[1].is_like(&Channel::frames::<(), u32>("others")));
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    name: &'static str,
    sizes: ChannelSizes,
    types: fn() -> TypeId,
    declared: fn() -> String,
    /// Reads the number of items that a coded batch claims, if batches may be coded.
    count_coded: Option<CountCoded>,
}

/// The kind of a channel, and the sizes of its types in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ChannelSizes {
    /// A cell of size one.
    Latest {
        /// Bytes of a value.
        value: u16,
    },
    /// Frames of items.
    Frames {
        /// Bytes of a frame's header, beside its number.
        header: u16,
        /// Bytes of an item.
        item: u16,
    },
}

/// A channel as peers tell each other of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelFormat {
    /// Its name.
    pub name: ChannelName,
    /// Its kind and sizes.
    pub sizes: ChannelSizes,
}

impl fmt::Display for ChannelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sizes {
            ChannelSizes::Latest { value } => write!(f, "`{}` of values of {value} bytes", self.name),
            ChannelSizes::Frames { header, item } => {
                write!(f, "`{}` of frames with headers of {header} and items of {item} bytes", self.name)
            }
        }
    }
}

impl Channel {
    /// A latest lane of `V`. Its name has 1 to 32 bytes; a longer one fails to compile.
    #[must_use]
    pub const fn latest<V: Fixed + Clone + PartialEq + fmt::Debug>(name: &'static str) -> Self {
        const { assert!(V::SIZE <= MAX_FIXED, "a value of a channel has at most 1024 bytes") }
        let sizes = ChannelSizes::Latest { value: V::SIZE as u16 };
        let declared = || format!("latest::<{}>", type_name::<V>());
        Self::new(name, sizes, TypeId::of::<V>, declared, None)
    }

    /// Its name has 1 to 32 bytes; a longer one fails to compile.
    pub(crate) const fn new(
        name: &'static str,
        sizes: ChannelSizes,
        types: fn() -> TypeId,
        declared: fn() -> String,
        count_coded: Option<CountCoded>,
    ) -> Self {
        assert!(
            !name.is_empty() && name.len() <= ChannelName::MAX_BYTES,
            "a channel's name has 1 to 32 bytes"
        );
        Self { name, sizes, types, declared, count_coded }
    }

    /// Its name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// Its kind and sizes.
    #[must_use]
    pub const fn sizes(&self) -> ChannelSizes {
        self.sizes
    }

    /// Whether it has the kind and the types of `other`.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        self.sizes == other.sizes && (self.types)() == (other.types)()
    }

    /// Reads the number of items that a coded batch claims. `None` if its batches are never coded.
    #[must_use]
    pub const fn count_coded(&self) -> Option<CountCoded> {
        self.count_coded
    }

    /// Its kind and types as code, such as `frames::<(), u32>`.
    #[must_use]
    pub fn declared(&self) -> String {
        (self.declared)()
    }
}

impl From<&Channel> for ChannelFormat {
    fn from(channel: &Channel) -> Self {
        Self { name: ChannelName::new(channel.name), sizes: channel.sizes }
    }
}

/// Whether these are not too many, and each has a name of its own.
pub(crate) const fn are_sound(channels: &[Channel]) -> bool {
    let mut one = 0;
    while one < channels.len() {
        let mut other = one + 1;
        while other < channels.len() {
            if same(channels[one].name.as_bytes(), channels[other].name.as_bytes()) {
                return false;
            }
            other += 1;
        }
        one += 1;
    }
    channels.len() <= MAX_CHANNELS
}

const fn same(one: &[u8], other: &[u8]) -> bool {
    let mut at = 0;
    while at < one.len() && at < other.len() && one[at] == other[at] {
        at += 1;
    }
    at == one.len() && at == other.len()
}

/// The channels of a peer, at most [`MAX_CHANNELS`].
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ChannelList(Vec<ChannelFormat>);

impl ChannelList {
    /// The channels of a protocol.
    #[must_use]
    pub fn of(channels: &[Channel]) -> Self {
        channels.iter().map(ChannelFormat::from).collect()
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The first difference from `other`: the number, and the two channels.
    #[must_use]
    pub fn difference(
        &self,
        other: &Self,
    ) -> Option<(ChannelNumber, Option<ChannelFormat>, Option<ChannelFormat>)> {
        (0..MAX_CHANNELS as u8).find_map(|number| {
            let (ours, theirs) = (self.0.get(usize::from(number)), other.0.get(usize::from(number)));
            (ours != theirs).then(|| (ChannelNumber(number), ours.cloned(), theirs.cloned()))
        })
    }
}

/// Those beyond [`MAX_CHANNELS`] are left out.
impl FromIterator<ChannelFormat> for ChannelList {
    fn from_iter<T: IntoIterator<Item = ChannelFormat>>(channels: T) -> Self {
        Self(channels.into_iter().take(MAX_CHANNELS).collect())
    }
}

impl Serialize for ChannelList {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

/// Only as many as there may be are read, and one at least: without any the hello is the plain one.
impl<'de> Deserialize<'de> for ChannelList {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(Channels)
    }
}

struct Channels;

impl<'de> Visitor<'de> for Channels {
    type Value = ChannelList;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "1 to {MAX_CHANNELS} channels")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<ChannelList, A::Error> {
        let mut channels = Vec::new();
        while let Some(channel) = sequence.next_element()? {
            if channels.len() == MAX_CHANNELS {
                return Err(A::Error::invalid_length(MAX_CHANNELS + 1, &self));
            }
            channels.push(channel);
        }
        if channels.is_empty() { Err(A::Error::invalid_length(0, &self)) } else { Ok(ChannelList(channels)) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn channel() -> impl Strategy<Value = ChannelFormat> {
        let sizes = prop_oneof![
            any::<u16>().prop_map(|value| ChannelSizes::Latest { value }),
            any::<(u16, u16)>().prop_map(|(header, item)| ChannelSizes::Frames { header, item }),
        ];
        (".{0,10}", sizes).prop_map(|(name, sizes)| ChannelFormat { name: ChannelName::new(&name), sizes })
    }

    proptest! {
        #[test]
        fn a_list_reads_back_if_it_has_one_to_sixteen_channels(
            channels in prop::collection::vec(channel(), 0..20),
        ) {
            let count = channels.len();
            let list = ChannelList(channels);
            let bytes = postcard::to_stdvec(&list).unwrap();
            let read = postcard::from_bytes::<ChannelList>(&bytes);
            prop_assert_eq!(read.ok(), (1..=MAX_CHANNELS).contains(&count).then_some(list));
            for cut in 0..bytes.len() {
                prop_assert!(postcard::from_bytes::<ChannelList>(&bytes[..cut]).is_err(), "{} bytes", cut);
            }
        }

        #[test]
        fn lists_differ_at_the_first_channel_that_does(
            channels in prop::collection::vec(channel(), 1..16), at in any::<prop::sample::Index>(),
        ) {
            let (list, mut other) = (ChannelList(channels.clone()), ChannelList(channels.clone()));
            prop_assert_eq!(list.difference(&other), None);
            let number = at.index(channels.len());
            other.0.truncate(number);
            let lacks = (ChannelNumber(number as u8), Some(channels[number].clone()), None);
            prop_assert_eq!(list.difference(&other), Some(lacks));
        }
    }

    #[test]
    fn names_are_one_to_one() {
        let named = Channel::latest::<()>;
        assert!(are_sound(&[named("a"), named("ab"), named("b")]));
        assert!(!are_sound(&[named("a"), named("b"), named("a")]));
        assert!(are_sound(&[]) && !are_sound(&[named("a"); 2]));
    }

    #[test]
    fn a_channel_has_the_sizes_and_the_types_of_its_declaration() {
        let cells = Channel::frames::<(), u32>("cells");
        assert_eq!(cells.sizes(), ChannelSizes::Frames { header: 0, item: 4 });
        assert!(
            cells.is_like(&Channel::frames::<(), u32>("other"))
                && !cells.is_like(&Channel::latest::<()>("a"))
        );
        assert_eq!(cells.declared(), "frames::<(), u32>");
        assert_eq!(
            ChannelFormat::from(&cells).to_string(),
            "`cells` of frames with headers of 0 and items of 4 bytes"
        );
    }
}
