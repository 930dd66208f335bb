//! The text of OBJ and STL files: its encoding and its lines.

use std::borrow::Cow;
use std::iter;

use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, WINDOWS_1252};
use thiserror::Error;

/// Why bytes are not readable text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NotText {
    /// UTF-32, which no program writes by default.
    #[error("it is in UTF-32: save it as UTF-8")]
    Utf32,
    /// Zeros that are not halves of letters, among other control characters.
    #[error("it is binary, not text; it may be damaged, or have the wrong ending")]
    Binary,
}

/// Text from bytes in UTF-8 or UTF-16. A line that is not UTF-8 is read as Windows-1252, of which Latin-1 is
/// a part. Zeros within it stay.
pub(super) fn decode(bytes: &[u8]) -> Result<Cow<'_, str>, NotText> {
    if bytes.starts_with(b"\xFF\xFE\0\0") || bytes.starts_with(b"\0\0\xFE\xFF") {
        return Err(NotText::Utf32);
    }
    let marked = Encoding::for_bom(bytes).filter(|(encoding, _)| [UTF_16LE, UTF_16BE].contains(encoding));
    if let Some((encoding, mark)) = marked.or_else(|| Some((unmarked_utf16(bytes)?, 0))) {
        let (text, _) = encoding.decode_without_bom_handling(bytes.get(mark..).unwrap_or_default());
        return Ok(text);
    }
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    // Old programs pad files with zeros, or end them with control-Z.
    let end = bytes.iter().rposition(|&byte| byte != 0 && byte != 0x1A).map_or(0, |last| last + 1);
    let text = bytes.get(..end).unwrap_or(bytes);
    if text.contains(&0) && is_binary(text) {
        return Err(NotText::Binary);
    }
    if let Ok(text) = std::str::from_utf8(text) {
        return Ok(Cow::Borrowed(text));
    }
    let mut decoded = String::with_capacity(text.len() + text.len() / 8);
    for line in text.split_inclusive(|&byte| byte == b'\n' || byte == b'\r') {
        match std::str::from_utf8(line) {
            Ok(line) => decoded.push_str(line),
            Err(_) => decoded.push_str(&WINDOWS_1252.decode_without_bom_handling(line).0),
        }
    }
    Ok(Cow::Owned(decoded))
}

/// UTF-16 without a byte order mark: one half of most letters is zero, always the same half.
fn unmarked_utf16(bytes: &[u8]) -> Option<&'static Encoding> {
    let pairs = bytes.get(..bytes.len().min(1 << 10)).unwrap_or_default().as_chunks::<2>().0;
    let zeros = |half: usize| pairs.iter().filter(|pair| pair.get(half) == Some(&0)).count();
    let mostly = |half: usize| 2 * zeros(half) > pairs.len() && zeros(1 - half) == 0;
    let big = || mostly(0).then_some(UTF_16BE);
    mostly(1).then_some(UTF_16LE).or_else(big)
}

/// Whether a file with zeros is binary. Programs write padded fields as text, and failed disks leave
/// stretches of zeros; but text has at most a few of the other control characters.
fn is_binary(bytes: &[u8]) -> bool {
    let start = bytes.get(..1 << 16).unwrap_or(bytes);
    let others = start.iter().filter(|&&byte| byte != 0).count();
    let is_control = |byte: &&u8| matches!(byte, 1..=8 | 14..=25 | 27..=31);
    50 * start.iter().filter(is_control).count() > others
}

/// A line's word and the rest. Joined files have byte order marks at the start of lines.
pub(super) fn statement(line: &str) -> (&str, &str) {
    let line = line.trim_start_matches(|letter: char| letter.is_ascii_whitespace() || letter == '\u{feff}');
    let end = line.bytes().position(|byte| byte.is_ascii_whitespace()).unwrap_or(line.len());
    line.split_at_checked(end).unwrap_or((line, ""))
}

/// The lines of a text, each with its number from 1 on. They end with LF, CRLF or CR. A backslash at the end
/// continues a line, unless it is a comment or a name.
pub(super) struct Lines<'t> {
    rest: &'t str,
    number: u32,
}

impl<'t> Lines<'t> {
    pub(super) const fn of(text: &'t str) -> Self {
        Self { rest: text, number: 0 }
    }

    /// The lines as they are, with their numbers: a backslash continues none.
    pub(super) fn uncontinued(mut self) -> impl Iterator<Item = (u32, &'t str)> {
        iter::from_fn(move || self.line().map(|line| (self.number, line)))
    }

    /// The next line of the text, unprocessed.
    fn line(&mut self) -> Option<&'t str> {
        if self.rest.is_empty() {
            return None;
        }
        self.number = self.number.saturating_add(1);
        let end = self.rest.bytes().position(|byte| byte == b'\n' || byte == b'\r');
        let Some((line, rest)) = end.and_then(|end| self.rest.split_at_checked(end)) else {
            return Some(std::mem::take(&mut self.rest));
        };
        let rest = rest.strip_prefix("\r\n").or_else(|| rest.get(1..));
        self.rest = rest.unwrap_or_default();
        Some(line)
    }
}

impl<'t> Iterator for Lines<'t> {
    type Item = (u32, Cow<'t, str>);

    fn next(&mut self) -> Option<Self::Item> {
        let line = self.line()?;
        let first = self.number;
        let goes_on = continued(line).filter(|head| may_go_on(head));
        let Some(head) = goes_on else { return Some((first, Cow::Borrowed(line))) };
        let mut joined = head.to_owned();
        while let Some(line) = self.line() {
            joined.push(' ');
            match continued(line) {
                Some(head) => joined.push_str(head),
                None => {
                    joined.push_str(line);
                    break;
                }
            }
        }
        Some((first, Cow::Owned(joined)))
    }
}

/// The part before the backslash of a continued line.
fn continued(line: &str) -> Option<&str> {
    let head = line.trim_ascii_end().strip_suffix('\\')?;
    // Comments may contain Windows paths.
    (without_comment(head).len() == head.len()).then_some(head)
}

/// Whether a backslash may continue a statement. Names may end in one: Windows paths, and letters in
/// Shift-JIS or GBK, whose second byte it may be.
fn may_go_on(head: &str) -> bool {
    let (word, rest) = statement(head);
    let is = |known: &str| word.eq_ignore_ascii_case(known);
    let is_name = ["o", "g", "usemtl", "newmtl"].into_iter().any(is);
    !is_name && (!is("mtllib") || rest.ends_with(|letter: char| letter.is_ascii_whitespace()))
}

/// The numbers of a line: the part before a `#`, except that of `1.#IND` and similar, which Windows programs
/// write for NaN.
pub(super) fn numbers(rest: &str) -> &str {
    let begins = |&(at, _): &(usize, &str)| !rest.get(..at).is_some_and(|before| before.ends_with('.'));
    let comment = rest.match_indices('#').find(begins);
    comment.and_then(|(at, _)| rest.get(..at)).unwrap_or(rest)
}

/// A name: a whole line without surrounding white space and a comment. `Tank #5` is a name, and in `Tank #
/// the old one` only the first word is.
pub(super) fn name(rest: &str) -> &str {
    without_comment(rest).trim()
}

/// A line without its comment: a `#` between white space, or at the start.
fn without_comment(line: &str) -> &str {
    let is_space = |byte: Option<&u8>| byte.is_none_or(u8::is_ascii_whitespace);
    let bytes = line.as_bytes();
    let starts = |&(at, _): &(usize, &str)| {
        let before = at.checked_sub(1).and_then(|before| bytes.get(before));
        is_space(before) && (before.is_none() || is_space(bytes.get(at + 1)))
    };
    let comment = line.match_indices('#').find(starts);
    comment.and_then(|(at, _)| line.get(..at)).unwrap_or(line)
}

/// The beginning of a text from a file, in quotes.
pub(super) fn excerpt(text: &str) -> String {
    const MOST: usize = 60;
    match text.char_indices().nth(MOST).and_then(|(end, _)| text.get(..end)) {
        Some(start) => format!("{start:?}..."),
        None => format!("{text:?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<(u32, String)> {
        Lines::of(text).map(|(number, line)| (number, line.into_owned())).collect()
    }

    #[test]
    fn lines_end_in_three_ways_and_keep_their_numbers() {
        let found: Vec<u32> = lines("a\nb\r\nc\rd\n\r\re").iter().map(|&(number, _)| number).collect();
        assert_eq!(found, [1, 2, 3, 4, 5, 6, 7]);
        let found: String = lines("a\nb\r\nc\rd\n\r\re").into_iter().map(|(_, line)| line + "|").collect();
        assert_eq!(found, "a|b|c|d|||e|");
    }

    #[test]
    fn a_backslash_joins_lines_but_not_comments() {
        let text = "f 1 2 \\\n 3\\  \r\n4\\\r5\n# C:\\models\\\nv 1\nf 1 # to \\\nf 2 \\";
        let found = lines(text);
        let numbers: Vec<u32> = found.iter().map(|&(number, _)| number).collect();
        assert_eq!(numbers, [1, 5, 6, 7, 8]);
        assert_eq!(found[0].1.split_whitespace().collect::<Vec<_>>(), ["f", "1", "2", "3", "4", "5"]);
        assert_eq!((&*found[1].1, &*found[2].1, &*found[4].1), ("# C:\\models\\", "v 1", "f 2 "));
    }

    #[test]
    fn a_backslash_at_the_end_of_a_name_is_a_part_of_it() {
        let found = lines("o C:\\\nG a \\\nmtllib a\\\nMTLLIB a.mtl \\\n b.mtl\nf 1 \\\n2\\\n3");
        let numbers: Vec<u32> = found.iter().map(|&(number, _)| number).collect();
        assert_eq!(numbers, [1, 2, 3, 4, 6]);
        assert_eq!((&*found[0].1, &*found[2].1), ("o C:\\", "mtllib a\\"));
    }

    #[test]
    fn what_is_no_number_is_no_comment() {
        assert_eq!(
            ["1 2#3", "1.#IND 2 # x", "-1.#QNAN", "#"].map(numbers),
            ["1 2", "1.#IND 2 ", "-1.#QNAN", ""]
        );
    }

    #[test]
    fn names_keep_a_number_sign_and_lose_a_comment() {
        let names =
            [" Tank #5 ", "Tank # old", "# all", "a#b", "Beh\u{e4}lter 5\u{a0}", "a\t#\tb", ""].map(name);
        assert_eq!(names, ["Tank #5", "Tank", "", "a#b", "Beh\u{e4}lter 5", "a", ""]);
    }

    #[test]
    fn each_encoding_is_read_or_named() {
        let text = "o Beh\u{e4}lter \u{914d}\n";
        let utf16 =
            |to_bytes: fn(u16) -> [u8; 2]| -> Vec<u8> { text.encode_utf16().flat_map(to_bytes).collect() };
        let (little, big) = (utf16(u16::to_le_bytes), utf16(u16::to_be_bytes));
        let mut marked: Vec<Vec<u8>> = vec![text.as_bytes().to_vec()];
        marked.push([b"\xEF\xBB\xBF", text.as_bytes()].concat());
        marked.push([b"\xFF\xFE", &*little].concat());
        marked.push([b"\xFE\xFF", &*big].concat());
        for bytes in marked {
            assert_eq!(decode(&bytes).unwrap(), text);
        }
        assert_eq!((decode(&little).unwrap(), decode(&big).unwrap()), (text.into(), text.into()));
        let utf32: Vec<u8> = "\u{feff}v".chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
        assert_eq!(decode(&utf32), Err(NotText::Utf32));
        assert_eq!(decode(b"v 0\0\x01\x02 0 1 0\n"), Err(NotText::Binary));
        assert_eq!(decode(b"v 0 0 0\n\x1A\0\0").unwrap(), "v 0 0 0\n");
        assert_eq!(decode(b"o a\0\0\nv 0 0 0").unwrap(), "o a\0\0\nv 0 0 0");
    }

    /// Files are put together from others.
    #[test]
    fn a_line_in_another_encoding_does_not_change_the_others() {
        assert_eq!(decode(b"o \xC3\xA4\no \xE4 \x80\n").unwrap(), "o \u{e4}\no \u{e4} \u{20ac}\n");
    }
}
