//! The types of one channel, as a protocol of its own: the typed halves of links are those of a protocol.

use std::any::{TypeId, type_name};
use std::fmt;
use std::marker::PhantomData;

use crate::{Channel, ChannelSizes, CountCoded, Fixed, Item, MAX_FIXED, Protocol};

/// The types of a channel of values `V`.
#[derive(Debug, Clone, PartialEq)]
pub struct LatestOf<V>(PhantomData<fn() -> V>);

/// The types of a channel of frames with headers `H` and items `I`.
#[derive(Debug, Clone, PartialEq)]
pub struct FramesOf<H, I>(PhantomData<fn() -> (H, I)>);

impl<V: Fixed + Clone + PartialEq + fmt::Debug> Protocol for LatestOf<V> {
    const NAME: &'static str = "";
    type Hello = ();
    type Latest = V;
    type Header = ();
    type Item = u32;
    type Message = ();

    fn name((): &()) -> String {
        String::new()
    }
}

impl<H: Fixed + Clone + PartialEq + fmt::Debug, I: Item> Protocol for FramesOf<H, I> {
    const NAME: &'static str = "";
    type Hello = ();
    type Latest = ();
    type Header = H;
    type Item = I;
    type Message = ();

    fn name((): &()) -> String {
        String::new()
    }
}

impl Channel {
    /// A frames lane with headers `H` and items `I`, which travel plain. Its name has 1 to 32 bytes; a longer
    /// one fails to compile.
    #[must_use]
    pub const fn frames<H: Fixed + Clone + PartialEq + fmt::Debug, I: Item>(name: &'static str) -> Self {
        let declared = || format!("frames::<{}, {}>", type_name::<H>(), type_name::<I>());
        Self::of::<FramesOf<H, I>>(name, declared, None)
    }

    /// A frames lane as `P` has it: with its header, its items and its coding. Of `P` nothing else counts.
    /// Peers do not compare the codings: they are part of the [name](Protocol::NAME) of the protocol.
    #[must_use]
    pub const fn frames_of<P: Protocol>(name: &'static str) -> Self {
        Self::of::<P>(name, || format!("frames_of::<{}>", type_name::<P>()), Some(P::count_coded))
    }

    const fn of<P: Protocol>(
        name: &'static str,
        declared: fn() -> String,
        count_coded: Option<CountCoded>,
    ) -> Self {
        const {
            assert!(P::Header::SIZE <= MAX_FIXED, "the header of a frame has at most 1024 bytes");
            assert!(P::Item::SIZE > 0 && P::Item::SIZE <= 256, "an item has 1 to 256 bytes");
        }
        let sizes = ChannelSizes::Frames { header: P::Header::SIZE as u16, item: P::Item::SIZE as u16 };
        Self::new(name, sizes, TypeId::of::<P>, declared, count_coded)
    }
}
