//! The text of OBJ files and their libraries: how it is encoded, and its lines.

use std::borrow::Cow;

use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, WINDOWS_1252};
use thiserror::Error;

/// Why bytes are no text that can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NotText {
    /// UTF-16 that does not say so.
    #[error("it looks like UTF-16 without a byte order mark: save it as UTF-8")]
    Utf16,
    /// UTF-32, which no program writes by default.
    #[error("it is in UTF-32: save it as UTF-8")]
    Utf32,
    /// Zeros that are no letters' halves.
    #[error("it is binary, not text; it may be damaged, or have the wrong ending")]
    Binary,
}

/// The text of bytes in UTF-8, or in UTF-16 with a byte order mark. A line that is not UTF-8 is read as
/// Windows-1252, of which Latin-1 is a part.
pub(super) fn decode(bytes: &[u8]) -> Result<Cow<'_, str>, NotText> {
    if bytes.starts_with(b"\xFF\xFE\0\0") || bytes.starts_with(b"\0\0\xFE\xFF") {
        return Err(NotText::Utf32);
    }
    match Encoding::for_bom(bytes) {
        Some((encoding, mark)) if encoding == UTF_16LE || encoding == UTF_16BE => {
            let (text, _) = encoding.decode_without_bom_handling(bytes.get(mark..).unwrap_or_default());
            return Ok(text);
        }
        _ => {}
    }
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    // Old programs pad files with zeros, or end them with control-Z.
    let end = bytes.iter().rposition(|&byte| byte != 0 && byte != 0x1A).map_or(0, |last| last + 1);
    let text = bytes.get(..end).unwrap_or(bytes);
    if text.contains(&0) {
        return Err(if looks_like_utf16(bytes) { NotText::Utf16 } else { NotText::Binary });
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

/// Whether one half of most letters is zero, always the same half.
fn looks_like_utf16(bytes: &[u8]) -> bool {
    let pairs = bytes.get(..bytes.len().min(1 << 10)).unwrap_or_default().as_chunks::<2>().0;
    let zeros = |half: usize| pairs.iter().filter(|pair| pair.get(half) == Some(&0)).count();
    let mostly = |half: usize| 2 * zeros(half) > pairs.len() && zeros(1 - half) == 0;
    mostly(0) || mostly(1)
}

/// The lines of a text, each with its number from 1 on. They end with LF, CRLF or CR. A line that ends with a
/// backslash goes on in the next one, unless it is a comment.
pub(super) struct Lines<'t> {
    rest: &'t str,
    number: u32,
}

impl<'t> Lines<'t> {
    pub(super) const fn of(text: &'t str) -> Self {
        Self { rest: text, number: 0 }
    }

    /// The next line of the text as it stands.
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
        let Some(head) = continued(line) else { return Some((first, Cow::Borrowed(line))) };
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

/// What stands before the backslash of a line that goes on.
fn continued(line: &str) -> Option<&str> {
    let head = line.trim_ascii_end().strip_suffix('\\')?;
    // Comments hold names of folders of Windows.
    (without_comment(head).len() == head.len()).then_some(head)
}

/// The numbers of a line: what stands before a `#`.
pub(super) fn numbers(rest: &str) -> &str {
    rest.split_once('#').map_or(rest, |(numbers, _)| numbers)
}

/// A name: all of a line but for white space around it, and but for a comment. `Tank #5` is a name, and in
/// `Tank # the old one` only the first word is.
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
        assert_eq!((decode(&little), decode(&big)), (Err(NotText::Utf16), Err(NotText::Utf16)));
        let utf32: Vec<u8> = "\u{feff}v".chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
        assert_eq!(decode(&utf32), Err(NotText::Utf32));
        assert_eq!(decode(b"v 0\0\x01\x02 0 1 0\n"), Err(NotText::Binary));
        assert_eq!(decode(b"v 0 0 0\n\x1A\0\0").unwrap(), "v 0 0 0\n");
    }

    /// Files are put together from others.
    #[test]
    fn a_line_in_another_encoding_does_not_change_the_others() {
        assert_eq!(decode(b"o \xC3\xA4\no \xE4 \x80\n").unwrap(), "o \u{e4}\no \u{e4} \u{20ac}\n");
    }
}
