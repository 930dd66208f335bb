//! The text form of an RVM file (`.rev`, or `.rvm` as well): the chunks of the binary form as lines.
//!
//! A chunk is a line of its four letters, a line of two numbers, the second of which is the version, and then
//! what the binary form has, each name on a line of its own. Matrices stand row by row.

use super::encoding::{Encoding, lines};
use super::file::{File, Order};
use super::shape::{Broken, Numbers};
use super::{RvmError, RvmPlace};
use crate::import::report::WarningKind;

/// How far into a file its head may reach, bytes.
const HEAD: usize = 1 << 16;

/// Whether a file that begins with these bytes is of the text form: its first line is HEAD.
pub(in crate::import) fn is_text(start: &[u8]) -> bool {
    let text = Encoding::default().decode_file(start);
    let first = lines(text.trim_start_matches(is_padding)).next();
    first.is_some_and(|first| first.trim() == "HEAD")
}

/// Reads a whole file, and returns where it ends.
pub(super) fn parse(bytes: &[u8], file: &mut File<'_>) -> Result<RvmPlace, RvmError> {
    // The head is in plain letters, whatever the names are in.
    let head = Encoding::default().decode_file(bytes.get(..HEAD).unwrap_or(bytes));
    let head: Vec<&str> = lines(&head).collect();
    let label = chunks(&head).next().map(|chunk| chunk.encoding());
    let text = label.and_then(Encoding::named).unwrap_or_default().decode_file(bytes);

    let lines: Vec<&str> = lines(&text).collect();
    for chunk in chunks(&lines) {
        let at = RvmPlace::Line(chunk.line);
        match chunk.id {
            "HEAD" => file.begin(chunk.encoding())?,
            "MODL" => {}
            "CNTB" => group(&chunk, file, at)?,
            "CNTE" => file.close()?,
            "PRIM" => file.primitive(&mut chunk.numbers(0), Order::Rows, at),
            "COLR" => match colour(&mut chunk.numbers(0)) {
                Ok((number, colour)) => file.colour(number, colour),
                Err(_) => file.skip("COLR, too short"),
            },
            "END:" | "END" => {
                file.end()?;
                if chunk.lines.iter().any(|line| !line.trim_matches(is_padding).is_empty()) {
                    file.report.warn(WarningKind::BehindEnd, 1);
                }
            }
            id => file.skip(id),
        }
    }
    Ok(RvmPlace::Line(lines.len() as u64))
}

fn group(chunk: &Chunk<'_, '_>, file: &mut File<'_>, at: RvmPlace) -> Result<(), RvmError> {
    let name = chunk.lines.first().copied().unwrap_or_default();
    let mut numbers = chunk.numbers(1);
    // A reference point that no primitive depends on.
    let material = numbers.reals::<3>().and_then(|_| numbers.count());
    let material =
        material.map_err(|_| RvmError::Malformed { at, what: "a group has no place and colour" })?;
    let transparency = if chunk.version < 3 { None } else { numbers.count().ok() };
    file.open(name, material, transparency, at)
}

fn colour(numbers: &mut Tokens<'_, '_>) -> Result<(u32, [u8; 3]), Broken> {
    let number = numbers.count()?;
    let [r, g, b] = numbers.reals()?;
    Ok((number, [r as u8, g as u8, b as u8]))
}

/// A chunk: its lines behind the two of its header.
struct Chunk<'l, 't> {
    id: &'t str,
    /// That of its letters, from 1 on.
    line: u64,
    version: u32,
    lines: &'l [&'t str],
}

/// The chunks that a file's lines make.
fn chunks<'l, 't>(lines: &'l [&'t str]) -> impl Iterator<Item = Chunk<'l, 't>> {
    let header = |at: usize| Some((at, header(lines.get(at..)?)?));
    let mut next = (0..lines.len()).find_map(header);
    std::iter::from_fn(move || {
        let (at, (id, version)) = next.take()?;
        next = (at + 1..lines.len()).find_map(header);
        let end = next.map_or(lines.len(), |(end, _)| end);
        let lines = lines.get(at + 2..end).unwrap_or_default();
        Some(Chunk { id, line: at as u64 + 1, version, lines })
    })
}

/// The letters and the version of the chunk that begins with these lines, if one does.
fn header<'t>(lines: &[&'t str]) -> Option<(&'t str, u32)> {
    let id = lines.first()?.trim_matches(is_padding);
    let mut numbers = lines.get(1).copied().unwrap_or_default().split_whitespace().map(str::parse);
    let version = match (numbers.next(), numbers.next(), numbers.next()) {
        (Some(Ok::<u32, _>(_)), Some(Ok(version)), None) => Some(version),
        _ => None,
    };
    let may_be_in_id = |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || byte == b':';
    let is_id = id.len() == 4 && id.starts_with(char::is_alphabetic) && id.bytes().all(may_be_in_id);
    match version {
        Some(version) if is_id || id == "END" => Some((id, version)),
        None if id == "END:" => Some((id, 0)),
        _ => None,
    }
}

/// What may stand around a text that says nothing.
fn is_padding(letter: char) -> bool {
    letter.is_whitespace() || "\0\u{1a}\u{feff}".contains(letter)
}

impl<'t> Chunk<'_, 't> {
    /// That which a head names, behind program, note, date and user; empty if it names none.
    fn encoding(&self) -> &'t str {
        self.lines.get(4).copied().unwrap_or_default().trim()
    }

    /// The numbers from one of its lines on.
    fn numbers(&self, first: usize) -> Tokens<'_, 't> {
        Tokens { lines: self.lines.get(first..).unwrap_or_default(), rest: "" }
    }
}

/// The numbers of a chunk.
struct Tokens<'l, 't> {
    lines: &'l [&'t str],
    /// Of the line before them.
    rest: &'t str,
}

impl<'t> Tokens<'_, 't> {
    fn word(&mut self) -> Option<&'t str> {
        loop {
            self.rest = self.rest.trim_start();
            if !self.rest.is_empty() {
                break;
            }
            let (line, lines) = self.lines.split_first()?;
            (self.rest, self.lines) = (line, lines);
        }
        // Columns are of fixed width: a long number touches the sign of the next one.
        let touches = |(at, letter): (usize, char)| {
            let before = self.rest.get(..at).and_then(|before| before.chars().next_back());
            let sign = letter == '-' && before.is_some_and(|before| before.is_ascii_digit() || before == '.');
            (letter.is_whitespace() || sign).then_some(at)
        };
        let end = self.rest.char_indices().find_map(touches).unwrap_or(self.rest.len());
        let (token, rest) = self.rest.split_at(end);
        self.rest = rest;
        Some(token)
    }
}

impl Numbers for Tokens<'_, '_> {
    fn count(&mut self) -> Result<u32, Broken> {
        self.word().ok_or(Broken::Short)?.parse().map_err(|_| Broken::Measure)
    }

    /// What is no number is not finite either.
    fn real(&mut self) -> Result<f64, Broken> {
        Ok(self.word().ok_or(Broken::Short)?.parse().unwrap_or(f64::NAN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_known_by_its_first_line() {
        for text in ["HEAD\n  1  2\n", "\u{feff}HEAD\r\n", "\n HEAD \r 1 1"] {
            assert!(is_text(text.as_bytes()), "{text:?}");
        }
        assert!(is_text(b"\xff\xfeH\0E\0A\0D\0\n\0"));
        for other in ["", "HEADER\n", "MODL\n", "# HEAD"] {
            assert!(!is_text(other.as_bytes()), "{other:?}");
        }
    }

    #[test]
    fn a_chunk_is_four_letters_and_two_numbers() {
        let text = "HEAD\n 1 2\nCNTB\nnote\n\nPRIM\n  1 1\n 8\nXYZ1\n 1 3\nEND:\n";
        let lines: Vec<&str> = lines(text).collect();
        let found: Vec<_> =
            chunks(&lines).map(|chunk| (chunk.id, chunk.line, chunk.version, chunk.lines.len())).collect();
        assert_eq!(found, [("HEAD", 1, 2, 3), ("PRIM", 6, 1, 1), ("XYZ1", 9, 3, 0), ("END:", 11, 0, 0)]);
    }

    #[test]
    fn numbers_go_on_from_line_to_line_and_may_touch() {
        let lines = [" 7", "", "-1234567.25-7654321.50  1e-3", " 1.#QNAN nan"];
        let mut tokens = Tokens { lines: &lines, rest: "" };
        assert_eq!(tokens.count(), Ok(7));
        assert_eq!(tokens.reals(), Ok([-1_234_567.25, -7_654_321.5, 1e-3]));
        assert!(tokens.reals::<2>().unwrap().iter().all(|number| number.is_nan()));
        assert_eq!(tokens.real(), Err(Broken::Short));
    }
}
