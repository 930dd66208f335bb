//! The text form of an RVM file (`.rev`, or `.rvm` as well): the chunks of the binary form as lines.
//!
//! A chunk is a line of its four letters, a line of two numbers, the second of which is the version, and then
//! the binary form's data, each name on a line of its own. Matrices are row by row.

use super::encoding::{Encoding, lines};
use super::file::{File, Order};
use super::shape::{Broken, Numbers};
use super::{FilePosition, RvmError};
use crate::import::report::WarningKind;

/// The longest head of a file, bytes.
const HEAD: usize = 1 << 16;

/// Whether a file that begins with these bytes is of the text form: its first line is HEAD.
pub(in crate::import) fn is_text(start: &[u8]) -> bool {
    let text = Encoding::default().decode_file(start);
    let first = lines(text.trim_start_matches(is_padding)).next();
    first.is_some_and(|first| first.trim() == "HEAD")
}

/// Reads a whole file, and returns its end.
pub(super) fn parse(bytes: &[u8], file: &mut File<'_>) -> Result<FilePosition, RvmError> {
    // The head is in ASCII, whatever the names' encoding.
    let head = Encoding::default().decode_file(bytes.get(..HEAD).unwrap_or(bytes));
    let (head, _) = single_spaced(lines(&head).collect());
    let label = chunks(&head).next().map(|chunk| chunk.encoding());
    let text = label.and_then(Encoding::named).unwrap_or_default().decode_file(bytes);

    let (lines, step) = single_spaced(lines(&text).collect());
    for chunk in chunks(&lines) {
        let at = FilePosition::Line((chunk.line - 1) * step + 1);
        match chunk.id {
            "HEAD" => file.begin(chunk.encoding())?,
            "MODL" => {}
            "CNTB" => group(&chunk, file, at)?,
            "CNTE" => file.close()?,
            "PRIM" => file.primitive(&mut chunk.numbers(0), Order::Rows, at),
            "COLR" => match colour(&mut chunk.numbers(0)) {
                Ok((number, colour)) => file.colour(number, colour),
                Err(_) => file.leave_out("COLR", "too short"),
            },
            "END:" | "END" => {
                file.end()?;
                if chunk.lines.iter().any(|line| !line.trim_matches(is_padding).is_empty()) {
                    file.report.warn(WarningKind::BehindEnd, 1);
                }
            }
            id => file.skip(id),
        }
        for id in chunk.lost() {
            file.leave_out(id, "without its two numbers");
        }
    }
    Ok(FilePosition::Line(lines.len() as u64 * step))
}

/// Removes the blank line after each line, if each has one: programs that copy text may double line ends.
/// Also returns how many lines of the file each stands for.
fn single_spaced(lines: Vec<&str>) -> (Vec<&str>, u64) {
    let is_blank = |line: &&str| line.trim_matches(is_padding).is_empty();
    if lines.len() > 2 && lines.iter().skip(1).step_by(2).all(is_blank) {
        return (lines.into_iter().step_by(2).collect(), 2);
    }
    (lines, 1)
}

fn group(chunk: &Chunk<'_, '_>, file: &mut File<'_>, at: FilePosition) -> Result<(), RvmError> {
    // A reference point that no primitive depends on, the colour's number, the transparency.
    let behind = |first: usize| {
        let mut numbers = chunk.numbers(first);
        let place = numbers.reals::<3>().ok()?;
        let material = numbers.count().ok()?;
        Some((place, material, numbers.count().ok().filter(|_| chunk.version >= 3)))
    };
    let name = chunk.lines.first().copied().unwrap_or_default();
    if let Some((_, material, transparency)) = behind(1) {
        return file.open(name, Some(material), transparency, at);
    }
    let nameless = behind(0).filter(|(place, ..)| place.iter().all(|number| number.is_finite()));
    let Some((_, material, transparency)) = nameless else { return file.open(name, None, None, at) };
    file.report.warn_of(WarningKind::BrokenGroup, "its name is missing", "");
    file.open("", Some(material), transparency, at)
}

fn colour(numbers: &mut Tokens<'_, '_>) -> Result<(u32, [u8; 3]), Broken> {
    let number = numbers.count()?;
    let [r, g, b] = numbers.reals()?;
    Ok((number, [r as u8, g as u8, b as u8]))
}

/// A chunk: its lines after the two of its header.
struct Chunk<'l, 't> {
    id: &'t str,
    /// The line of its letters, from 1 on.
    line: u64,
    version: u32,
    lines: &'l [&'t str],
}

/// The chunks that a file's lines make.
fn chunks<'l, 't>(lines: &'l [&'t str]) -> impl Iterator<Item = Chunk<'l, 't>> {
    let header = |at: usize| Some((at, header(lines.get(at..)?)?));
    let mut next = (0..lines.len()).find_map(header);
    std::iter::from_fn(move || {
        let (at, (id, version, length)) = next.take()?;
        next = (at + 1..lines.len()).find_map(header);
        let end = next.map_or(lines.len(), |(end, _)| end);
        let lines = lines.get(at + length..end).unwrap_or_default();
        Some(Chunk { id, line: at as u64 + 1, version, lines })
    })
}

/// The letters, the version and the lines of the header that begins with these lines, if one does. Blank
/// lines may be within it.
fn header<'t>(lines: &[&'t str]) -> Option<(&'t str, u32, usize)> {
    let id = lines.first()?.trim_matches(is_padding);
    let may_be_in_id = |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || byte == b':';
    let is_id = id.len() == 4 && id.starts_with(char::is_alphabetic) && id.bytes().all(may_be_in_id);
    if !is_id && id != "END" {
        return None;
    }
    let mut behind = (2..).zip(lines.iter().copied().skip(1));
    let (length, numbers) =
        behind.find(|(_, line)| !line.trim_matches(is_padding).is_empty()).unwrap_or_default();
    let mut words = numbers.split_whitespace();
    let words = [words.next(), words.next(), words.next()];
    let version = match words {
        [Some(first), Some(version), None] if first.parse::<u32>().is_ok() => version.parse().ok(),
        _ => None,
    };
    // A group may have the name END: then a place follows.
    let is_place = || words.iter().flatten().filter(|word| word.parse::<f64>().is_ok()).count() == 3;
    match version {
        Some(version) => Some((id, version, length)),
        None => (id == "END:" && !is_place()).then_some((id, 0, 1)),
    }
}

/// Insignificant characters around a text.
fn is_padding(letter: char) -> bool {
    letter.is_whitespace() || "\0\u{1a}\u{feff}".contains(letter)
}

impl<'t> Chunk<'_, 't> {
    /// The encoding named in a head, after program, note, date and user; empty without one.
    fn encoding(&self) -> &'t str {
        self.lines.get(4).copied().unwrap_or_default().trim()
    }

    /// Lines in it that should begin chunks of their own and do not.
    fn lost(&self) -> impl Iterator<Item = &'t str> {
        let names = match self.id {
            "HEAD" => 5,
            "MODL" => 2,
            "CNTB" => 1,
            _ => 0,
        };
        let lines = self.lines.iter().skip(names).map(|line| line.trim_matches(is_padding));
        lines.filter(|line| ["PRIM", "CNTB", "CNTE"].contains(line))
    }

    /// The numbers from one of its lines on.
    fn numbers(&self, first: usize) -> Tokens<'_, 't> {
        Tokens { lines: self.lines.get(first..).unwrap_or_default(), rest: "" }
    }
}

/// The numbers of a chunk.
struct Tokens<'l, 't> {
    lines: &'l [&'t str],
    /// The rest of the current line.
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
        // Columns have a fixed width: a long number touches the sign of the next one.
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
        let word = self.word().ok_or(Broken::Short)?;
        // Some programs write all numbers in one form, `4.0`.
        let real = || word.parse().ok().filter(|real: &f64| real.fract() == 0.0 && *real >= 0.0);
        word.parse().ok().or_else(|| real().map(|real| real as u32)).ok_or(Broken::Measure)
    }

    /// Invalid numbers become NaN.
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
        assert_eq!(found, [("HEAD", 1, 2, 3), ("PRIM", 6, 1, 1), ("XYZ1", 9, 3, 0), ("END:", 11, 0, 1)]);
        for end in ["END:\n\n\n 1 1\n", "END:", "END:\nby me"] {
            let lines: Vec<&str> = super::lines(end).collect();
            assert_eq!(header(&lines).map(|(id, ..)| id), Some("END:"), "{end:?}");
        }
        assert_eq!(header(&["END:", "0.00 0.00 1.0"]), None);
    }

    #[test]
    fn numbers_go_on_from_line_to_line_and_may_touch() {
        let lines = [" 7.0", "", "-1234567.25-7654321.50  1e-3", " 1.#QNAN nan"];
        let mut tokens = Tokens { lines: &lines, rest: "" };
        assert_eq!(tokens.count(), Ok(7));
        assert_eq!(tokens.reals(), Ok([-1_234_567.25, -7_654_321.5, 1e-3]));
        assert!(tokens.reals::<2>().unwrap().iter().all(|number| number.is_nan()));
        assert_eq!(tokens.real(), Err(Broken::Short));
    }
}
