//! The types of one channel, as a protocol of its own: the typed halves of links are those of a protocol.

use std::fmt;
use std::marker::PhantomData;

use crate::{Fixed, Item, Protocol};

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
