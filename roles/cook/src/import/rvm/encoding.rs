//! The character encoding of a file's names.
//!
//! The head of a file may name an encoding, in words that vary between programs: "Unicode UTF-8", "Japanese
//! Shift-JIS", "Code Page 1251". Bytes are read in it if valid. All others are read as UTF-8 if valid, and
//! else as Windows-1252, of which Latin-1 is a part.

use encoding_rs::{Encoding as Table, ISO_2022_JP, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};

/// The encoding that a file names, if it is known.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Encoding(Option<&'static Table>);

/// Non-standard words of labels, and the standard label of each. The first match counts.
const WORDS: [(&str, &str); 15] = [
    ("shift", "shift_jis"),
    ("japan", "shift_jis"),
    ("gb18030", "gb18030"),
    ("simplified", "gbk"),
    ("traditional", "big5"),
    ("korea", "euc-kr"),
    ("russia", "windows-1251"),
    ("greek", "windows-1253"),
    ("turk", "windows-1254"),
    ("hebrew", "windows-1255"),
    ("arabic", "windows-1256"),
    ("baltic", "windows-1257"),
    ("thai", "windows-874"),
    ("central europe", "windows-1250"),
    ("western", "windows-1252"),
];

/// Windows code pages whose label is not `windows-` and their number.
const PAGES: [(u32, &str); 12] = [
    (866, "ibm866"),
    (932, "shift_jis"),
    (936, "gbk"),
    (949, "euc-kr"),
    (950, "big5"),
    (20866, "koi8-r"),
    (20932, "euc-jp"),
    (51932, "euc-jp"),
    (51949, "euc-kr"),
    (54936, "gb18030"),
    (28591, "iso-8859-1"),
    (65001, "utf-8"),
];

impl Encoding {
    /// The encoding of a label; `None` if unknown. An empty label names none.
    pub(super) fn named(label: &str) -> Option<Self> {
        let label = label.trim().to_lowercase();
        if label.is_empty() {
            return Some(Self(None));
        }
        let words: Vec<&str> = label
            .split(|c: char| !c.is_alphanumeric() && !"-_:.".contains(c))
            .filter(|w| !w.is_empty())
            .collect();
        let pairs = words.windows(2).map(|pair| pair.join("-"));
        // "chinese" alone is ambiguous.
        let single = words.iter().rev().filter(|&&word| word != "chinese").map(|&word| word.to_owned());
        let mut labels = std::iter::once(words.join("-")).chain(pairs).chain(single);
        let standard = labels.find_map(|label| table(&label).or_else(|| table(&label.replace('-', ""))));
        let page = || words.iter().find_map(|word| code_page(word));
        let word = || WORDS.iter().find(|(word, _)| label.contains(word)).and_then(|(_, label)| table(label));
        standard.or_else(page).or_else(word).map(|table| Self(Some(table)))
    }

    /// A name of a file, and whether it is valid in the file's declared encoding.
    pub(super) fn decode(self, bytes: &[u8]) -> (String, bool) {
        let named = self.0.and_then(|table| table.decode_without_bom_handling_and_without_replacement(bytes));
        match named {
            Some(text) => (text.into_owned(), true),
            None => (guess(bytes), self.0.is_none()),
        }
    }

    /// A whole text file, which may be marked as Unicode.
    pub(super) fn decode_file(self, bytes: &[u8]) -> String {
        let unicode = Table::for_bom(bytes).or(match bytes {
            [0, first, ..] if *first != 0 => Some((UTF_16BE, 0)),
            [first, 0, ..] if *first != 0 => Some((UTF_16LE, 0)),
            _ => None,
        });
        if let Some((table, mark)) = unicode {
            let text = bytes.get(mark..).unwrap_or_default();
            // Marked as UTF-8, but followed by another encoding. The end may cut a character.
            let is_utf8 = || str::from_utf8(text).map_or_else(|error| error.error_len().is_none(), |_| true);
            if table != UTF_8 || is_utf8() {
                return table.decode_without_bom_handling(text).0.into_owned();
            }
        }
        if self.0 != Some(ISO_2022_JP)
            && let Ok(text) = str::from_utf8(bytes)
        {
            return text.to_owned();
        }
        // Line by line, so that a bad one does not affect the others.
        let lines = bytes.split_inclusive(|&byte| byte == b'\n');
        lines.map(|line| self.decode(line).0).collect()
    }
}

/// UTF-8 if valid.
fn guess(bytes: &[u8]) -> String {
    match str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => WINDOWS_1252.decode_without_bom_handling(bytes).0.into_owned(),
    }
}

/// The table of a standard label. Names end with a zero byte, so that they cannot be UTF-16.
fn table(label: &str) -> Option<&'static Table> {
    let table = Table::for_label_no_replacement(label.as_bytes())?;
    (table.is_ascii_compatible() || table == ISO_2022_JP).then_some(table)
}

/// The table of a code page, such as `cp932`, `1251` or `windows1252`.
fn code_page(word: &str) -> Option<&'static Table> {
    let number: u32 = word.trim_start_matches(|c: char| !c.is_ascii_digit()).parse().ok()?;
    let known = PAGES.iter().find(|(page, _)| *page == number).map(|(_, label)| *label);
    known.map_or_else(|| table(&format!("windows-{number}")), table)
}

/// The lines of a text, ended as on any system.
pub(super) fn lines(text: &str) -> impl Iterator<Item = &str> {
    let end = if text.contains('\n') { '\n' } else { '\r' };
    text.split(end).map(|line| line.strip_suffix('\r').unwrap_or(line))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name_of(label: &str) -> Option<&'static str> {
        Encoding::named(label).map(|encoding| encoding.0.map_or("none", Table::name))
    }

    #[test]
    fn labels_of_any_program_are_known() {
        for (label, name) in [
            ("", "none"),
            ("Unicode UTF-8", "UTF-8"),
            ("UTF8", "UTF-8"),
            ("unicode utf 8", "UTF-8"),
            ("ISO-8859-1", "windows-1252"),
            ("ISO 8859-5", "ISO-8859-5"),
            ("ISO8859-15", "ISO-8859-15"),
            ("Latin-1", "windows-1252"),
            ("Western European (Windows)", "windows-1252"),
            ("Windows-1251", "windows-1251"),
            ("windows 1250", "windows-1250"),
            ("Code Page 1251", "windows-1251"),
            ("CP936", "GBK"),
            ("65001", "UTF-8"),
            ("Shift-JIS", "Shift_JIS"),
            ("Japanese Shift-JIS", "Shift_JIS"),
            ("Japanese (Shift JIS)", "Shift_JIS"),
            ("SJIS", "Shift_JIS"),
            ("Japanese EUC-JP", "EUC-JP"),
            ("GBK", "GBK"),
            ("GB18030", "gb18030"),
            ("Chinese GB18030", "gb18030"),
            ("Simplified Chinese (GB2312)", "GBK"),
            ("Simplified Chinese", "GBK"),
            ("Traditional Chinese (Big5)", "Big5"),
            ("Big-5", "Big5"),
            ("Korean", "EUC-KR"),
            ("Korean EUC-KR", "EUC-KR"),
            ("KOI8-R", "KOI8-R"),
            ("Traditional Chinese", "Big5"),
            ("Cyrillic", "ISO-8859-5"),
            ("Windows Russian", "windows-1251"),
        ] {
            assert_eq!(name_of(label), Some(name), "{label:?}");
        }
        for unknown in ["Klingon", "UTF-16", "42", "encoding"] {
            assert_eq!(name_of(unknown), None, "{unknown:?}");
        }
    }

    #[test]
    fn names_are_read_as_the_file_says_and_else_as_they_can_be() {
        let named = |label, bytes: &[u8]| Encoding::named(label).unwrap().decode(bytes);
        assert_eq!(named("Shift-JIS", b"/\x94z\x8a\xc7-1"), ("/配管-1".into(), true));
        assert_eq!(named("GBK", b"/\xb9\xdc\xb5\xc0-1"), ("/管道-1".into(), true));
        assert_eq!(named("", "/Behälter".as_bytes()), ("/Behälter".into(), true));
        assert_eq!(named("", b"/Beh\xe4lter \x96"), ("/Behälter \u{2013}".into(), true));
        assert_eq!(named("UTF-8", b"/Beh\xe4lter"), ("/Behälter".into(), false));
        assert_eq!(named("Shift-JIS", b"/\xff"), ("/ÿ".into(), false));
    }

    #[test]
    fn a_text_file_is_unicode_if_it_can_be() {
        let read = |label, bytes: &[u8]| Encoding::named(label).unwrap().decode_file(bytes);
        let utf16 = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
        assert_eq!(read("", &[b"\xff\xfe", &*utf16("Röhr")].concat()), "Röhr");
        assert_eq!(read("", &utf16("CADC ö")), "CADC ö");
        assert_eq!(read("", b"\xfe\xff\0A\0\xf6"), "Aö");
        assert_eq!(read("GBK", "\u{feff}管".as_bytes()), "管");
        assert_eq!(read("GBK", "管".as_bytes()), "管");
        assert_eq!(read("GBK", b"\xef\xbb\xbf\xe7\xae\xa1\xe7\xae"), "管\u{fffd}");
        assert_eq!(read("GBK", b"\xb9\xdc\n\xff\n"), "管\nÿ\n");
        assert_eq!(read("UTF-8", b"R\xf6hr\nR\xc3\xb6hr"), "Röhr\nRöhr");
        assert_eq!(read("", b"\xef\xbb\xbfR\xf6hr"), "ï»¿Röhr");
        assert_eq!(read("ISO-2022-JP", b"\x1b$B4I\x1b(B\n"), "管\n");
        assert_eq!(read("", b""), "");
    }

    #[test]
    fn lines_end_as_on_any_system() {
        for text in ["a\n\nb", "a\r\n\r\nb", "a\r\rb"] {
            assert_eq!(lines(text).collect::<Vec<_>>(), ["a", "", "b"], "{text:?}");
        }
    }
}
