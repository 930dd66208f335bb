//! Repairs JSON that a strict reader refuses for minor errors, from programs that assemble it by hand or test
//! it only with their own reader.

use std::borrow::Cow;
use std::fmt::Write;

use encoding_rs::WINDOWS_1252;

/// JSON, with its repairs and their counts.
#[derive(Default)]
pub(super) struct Mended {
    pub json: Vec<u8>,
    pub faults: Vec<(&'static str, u64)>,
}

/// The deepest nesting of values: that of the JSON reader, which has a few levels of its own.
const DEEPEST: usize = 100;

/// Repairs errors with only one possible reading. Line breaks stay, for line numbers in messages.
pub(super) fn mend(mut rest: &[u8]) -> Mended {
    let mut mended = Mended { json: Vec::with_capacity(rest.len()), ..Mended::default() };
    let mut depth = 0;
    while let Some((&byte, behind)) = rest.split_first() {
        let token = match byte {
            b'"' => string(rest),
            b'{' | b'[' if depth == DEEPEST => nested(rest),
            b'{' | b'[' | b'}' | b']' | b',' | b':' | b' ' | b'\t' | b'\n' | b'\r' => 1,
            _ => rest.iter().position(|byte| b"{}[],: \t\n\r\"".contains(byte)).unwrap_or(rest.len()),
        };
        let (token, after) = rest.split_at_checked(token.max(1)).unwrap_or((rest, &[]));
        rest = after;
        match byte {
            b'"' => mended.text(token),
            b'{' | b'[' if token.len() > 1 => {
                mended.fault("values nested too deep left out");
                mended.json.extend(b"null");
            }
            b'{' | b'[' => {
                depth += 1;
                mended.json.push(byte);
            }
            b'}' | b']' => {
                mended.close(byte);
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    if !behind.iter().all(|byte| byte.is_ascii_whitespace() || *byte == 0) {
                        mended.fault("bytes behind the document ignored");
                    }
                    break;
                }
            }
            b',' | b':' | b' ' | b'\t' | b'\n' | b'\r' => mended.json.push(byte),
            _ => mended.word(token),
        }
    }
    mended
}

/// The length of the text that begins here, with its quotes.
fn string(rest: &[u8]) -> usize {
    let mut is_escaped = false;
    let end = rest.iter().skip(1).position(|byte| {
        let is_end = *byte == b'"' && !is_escaped;
        is_escaped = *byte == b'\\' && !is_escaped;
        is_end
    });
    end.map_or(rest.len(), |end| end + 2)
}

/// The length of the value that begins here.
fn nested(rest: &[u8]) -> usize {
    let (mut at, mut depth) = (0, 0usize);
    while let Some(&byte) = rest.get(at) {
        at += match byte {
            b'"' => rest.get(at..).map_or(1, string),
            _ => 1,
        };
        match byte {
            b'{' | b'[' => depth += 1,
            b'}' | b']' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    at
}

impl Mended {
    fn fault(&mut self, what: &'static str) {
        match self.faults.iter_mut().find(|(known, _)| *known == what) {
            Some((_, count)) => *count += 1,
            None => self.faults.push((what, 1)),
        }
    }

    /// A closing bracket; a comma before it is dropped.
    fn close(&mut self, bracket: u8) {
        let end = self.json.trim_ascii_end().len();
        if self.json.get(..end).is_some_and(|json| json.ends_with(b",")) {
            self.json.truncate(end - 1);
            self.fault("commas before a bracket ignored");
        }
        self.json.push(bracket);
    }

    /// A number or a word.
    fn word(&mut self, token: &[u8]) {
        let is_whole = token.iter().all(u8::is_ascii_digit) && !(token.starts_with(b"0") && token.len() > 1);
        if is_whole && token.len() < 19
            || matches!(token, b"true" | b"false" | b"null")
            || serde_json::from_slice::<f64>(token).is_ok()
        {
            self.json.extend(token);
            return;
        }
        let written = str::from_utf8(token).unwrap_or_default();
        match written {
            "True" => self.json.extend(b"true"),
            "False" => self.json.extend(b"false"),
            "None" | "undefined" => self.json.extend(b"null"),
            // Also `+1`, `.5` and `1.`
            _ => match written.parse::<f64>().ok().and_then(serde_json::Number::from_f64) {
                Some(number) => self.json.extend(number.to_string().bytes()),
                None => {
                    self.fault("values that are no finite numbers taken as null");
                    self.json.extend(b"null");
                }
            },
        }
    }

    /// A text with its quotes.
    fn text(&mut self, token: &[u8]) {
        if let Ok(text) = str::from_utf8(token)
            && !text.contains(|letter: char| letter == '\\' || letter.is_ascii_control())
        {
            self.json.extend(token);
            return;
        }
        let text = match str::from_utf8(token) {
            Ok(text) => Cow::Borrowed(text),
            Err(_) => {
                self.fault("texts that are not UTF-8 read as Windows-1252");
                WINDOWS_1252.decode_without_bom_handling(token).0
            }
        };
        let mut mended = String::with_capacity(text.len());
        let mut rest = &*text;
        while let Some(letter) = rest.chars().next() {
            if letter == '\\' {
                let (length, escape) = escape(rest);
                if escape.as_ref() != rest.get(..length).unwrap_or_default() {
                    self.fault("letters that are written wrongly replaced");
                }
                mended.push_str(&escape);
                rest = rest.get(length..).unwrap_or_default();
                continue;
            }
            rest = rest.get(letter.len_utf8()..).unwrap_or_default();
            if letter.is_ascii_control() && letter != '\x7f' {
                // Writing to a String cannot fail.
                let _ = write!(mended, "\\u{:04x}", u32::from(letter));
            } else {
                mended.push(letter);
            }
        }
        self.json.extend(mended.bytes());
    }
}

/// The length of the escape that begins here, and its replacement.
fn escape(text: &str) -> (usize, Cow<'_, str>) {
    let unit = |at: usize| {
        let digits = text.get(at..at + 6)?.strip_prefix("\\u")?;
        digits.bytes().all(|digit| digit.is_ascii_hexdigit()).then(|| u32::from_str_radix(digits, 16).ok())?
    };
    let whole = |length: usize| (length, Cow::Borrowed(text.get(..length).unwrap_or_default()));
    match (unit(0), unit(6), text.as_bytes().get(1)) {
        (Some(0xd800..=0xdbff), Some(0xdc00..=0xdfff), _) => whole(12),
        // Half a surrogate pair of UTF-16.
        (Some(0xd800..=0xdfff), ..) => (6, Cow::Borrowed("\\ufffd")),
        (Some(_), ..) => whole(6),
        (None, _, Some(b'"' | b'\\' | b'/' | b'b' | b'f' | b'n' | b'r' | b't')) => whole(2),
        // A literal backslash, as in Windows paths.
        (None, ..) => (1, Cow::Borrowed("\\\\")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mended(json: &[u8]) -> (String, u64) {
        let Mended { json, faults } = mend(json);
        (String::from_utf8(json).unwrap(), faults.iter().map(|(_, count)| count).sum())
    }

    #[test]
    fn what_can_be_read_in_one_way_is_mended_and_counted() {
        for (json, expected, faults) in [
            (
                &br#"{"a":[1,-2.5e3,true,"x\n\u00e4\ud83d\ude00"]}"#[..],
                r#"{"a":[1,-2.5e3,true,"x\n\u00e4\ud83d\ude00"]}"#,
                0,
            ),
            (b"[NaN,-Infinity,1e400,what]", "[null,null,null,null]", 4),
            (b"[True,None,+1,.5,1.]", "[true,null,1.0,0.5,1.0]", 0),
            (b"[1,2,]", "[1,2]", 1),
            (b"{\"a\":1 ,\n}\0\0", "{\"a\":1 }", 1),
            (b"[1] and more", "[1]", 1),
            (b"[\"Beh\xe4lter\"]", "[\"Beh\u{e4}lter\"]", 1),
            (b"[\"a\tb\"]", "[\"a\\u0009b\"]", 0),
            (br#"["a\ud800b","C:\dir","\udc00"]"#, r#"["a\ufffdb","C:\\dir","\ufffd"]"#, 3),
            (b"[\"cut", "[\"cut", 0),
            (b"[1 2", "[1 2", 0),
        ] {
            assert_eq!(mended(json), (expected.to_owned(), faults), "{}", String::from_utf8_lossy(json));
        }
    }

    #[test]
    fn what_is_nested_too_deep_is_left_out() {
        let deep = format!("[{}{}{},7]", "[".repeat(3_000), r#""]\"]""#, "]".repeat(3_000));
        let (json, faults) = mended(deep.as_bytes());
        assert_eq!(faults, 1);
        assert_eq!(json, format!("[{}null{},7]", "[".repeat(DEEPEST - 1), "]".repeat(DEEPEST - 1)));
    }
}
