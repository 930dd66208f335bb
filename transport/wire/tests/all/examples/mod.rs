//! The examples in a page about the wire format: for the tests of all crates that have such a page.

use std::collections::BTreeMap;

use bytes::BytesMut;
use trimaran_wire::{Decoder, Format, Message};

/// The examples of `page` by name: each is a fenced block `hex NAME` of hexadecimal bytes, with a comment
/// behind a `#` in any line.
pub(crate) fn examples_of(page: &'static str) -> BTreeMap<&'static str, Vec<u8>> {
    page.split("\n```hex ")
        .skip(1)
        .map(|block| {
            let (name, rest) = block.split_once('\n').unwrap();
            let (body, _) = rest.split_once("\n```").unwrap();
            let digits =
                body.lines().filter_map(|line| line.split('#').next()).flat_map(str::split_whitespace);
            (name, digits.map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect())
        })
        .collect()
}

/// Checks that each message is written as its example, and that the example reads back as the message. The
/// page has so many `others`.
pub(crate) fn check(
    examples: &BTreeMap<&str, Vec<u8>>,
    messages: Vec<(&str, Message)>,
    format: Format,
    others: usize,
) {
    assert_eq!(examples.len(), messages.len() + others);
    for (name, message) in messages {
        let mut out = BytesMut::new();
        message.encode(&mut out);
        assert_eq!(hex(&out), hex(examples.get(name).map_or(&[], Vec::as_slice)), "the example {name}");
        let mut decoder = Decoder::new(format);
        decoder.push(&out);
        assert_eq!(decoder.next_message(), Ok(Some(message)), "the example {name}");
        assert_eq!(decoder.pending(), 0, "the example {name}");
    }
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x} ")).collect()
}
