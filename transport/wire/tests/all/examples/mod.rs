//! The examples in a page about the wire format: for the tests of all crates that have such a page.

use std::collections::BTreeMap;

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
