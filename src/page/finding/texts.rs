//! Texts without their separators, one behind the other, so that one pass searches all of them.

use memchr::memmem::Finder;

/// Ends each text. No text has it, as it is neither a letter nor a digit.
const END: u8 = b'\n';

/// The letters and digits of a text in lower case: names of parts use different separators in different
/// places.
pub(super) fn bare(text: &str) -> String {
    text.to_lowercase().chars().filter(|letter| letter.is_alphanumeric()).collect()
}

/// Bare texts, numbered as they were added. They have less than 4 GiB: see [`Texts::bytes`].
#[derive(Debug, Default)]
pub(super) struct Texts {
    bytes: Vec<u8>,
    /// Where each text begins.
    starts: Vec<u32>,
}

impl Texts {
    /// Adds the bare form of a text.
    pub(super) fn push(&mut self, text: &str) {
        self.starts.push(self.bytes.len() as u32);
        self.bytes.extend_from_slice(bare(text).as_bytes());
        self.bytes.push(END);
    }

    /// Bytes of all texts.
    pub(super) const fn bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Bytes of memory.
    pub(super) const fn memory(&self) -> usize {
        self.bytes.capacity() + self.starts.capacity() * size_of::<u32>()
    }

    /// A text; empty past the last one.
    pub(super) fn get(&self, number: u32) -> &[u8] {
        let start = self.starts.get(number as usize).copied();
        start.and_then(|start| self.bytes.get(start as usize..self.end(number))).unwrap_or_default()
    }

    /// Where a text ends.
    fn end(&self, number: u32) -> usize {
        let next = self.starts.get(number as usize + 1).map_or(self.bytes.len(), |next| *next as usize);
        next.saturating_sub(1)
    }

    /// Calls `found` with the number of each text that contains `wanted`, a bare text that is not empty.
    pub(super) fn each_with(&self, wanted: &str, mut found: impl FnMut(u32)) {
        let finder = Finder::new(wanted);
        let (mut from, mut number) = (0, 0);
        while let Some(at) = self.bytes.get(from..).and_then(|rest| finder.find(rest)) {
            let at = from + at;
            while self.end(number) < at {
                number += 1;
            }
            found(number);
            from = self.end(number);
        }
    }

    /// Calls `found` with the number of each text for which `is_it` holds.
    pub(super) fn each(&self, is_it: impl Fn(&[u8]) -> bool, mut found: impl FnMut(u32)) {
        for number in 0..self.starts.len() as u32 {
            if is_it(self.get(number)) {
                found(number);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn found(texts: &[String], wanted: &str) -> Vec<u32> {
        let mut all = Texts::default();
        texts.iter().for_each(|text| all.push(text));
        let mut found = Vec::new();
        all.each_with(wanted, |number| found.push(number));
        found
    }

    #[test]
    fn a_bare_text_has_neither_separators_nor_case() {
        assert_eq!(bare(" /20-CE50_A.(2) "), "20ce50a2");
        assert_eq!(bare("Größe Ø½"), "größeø½");
        assert_eq!(bare("-/ _"), "");
        // A dot that stands alone is no letter.
        assert_eq!(bare("İ"), "i");
    }

    #[test]
    fn no_match_reaches_into_the_next_text() {
        let texts = ["ab", "", "ba", "-", "bab"].map(str::to_owned);
        assert_eq!(found(&texts, "bb"), [] as [u32; 0]);
        assert_eq!(found(&texts, "ba"), [2, 4]);
        assert_eq!(found(&texts, "b"), [0, 2, 4]);
        assert_eq!(found(&[], "b"), [] as [u32; 0]);
    }

    proptest! {
        /// Each text once, in order, as if each was searched alone.
        #[test]
        fn all_texts_are_searched_as_each_alone(
            texts in prop::collection::vec("[ab é-]{0,6}", 0..12),
            wanted in "[abé]{1,3}",
        ) {
            let alone = |(number, text): (u32, &String)| bare(text).contains(&wanted).then_some(number);
            let expected: Vec<u32> = (0..).zip(&texts).filter_map(alone).collect();
            prop_assert_eq!(found(&texts, &wanted), expected);
        }
    }
}
