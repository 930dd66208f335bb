//! The header of a PLY file: lines of text that describe its rows.

use super::PlyError;
use crate::import::text::excerpt;

/// The contents of a file, as its header declares them.
pub(super) struct Header {
    pub(super) encoding: Encoding,
    /// In the order of their rows.
    pub(super) elements: Vec<Element>,
    /// The texture that a comment names, as MeshLab writes it.
    pub(super) texture: Option<String>,
    /// The first byte behind it.
    pub(super) end: usize,
    /// Its last line, from 1 on.
    pub(super) line: u32,
}

/// How values are written.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// Rows of one kind.
pub(super) struct Element {
    pub(super) name: String,
    pub(super) rows: u64,
    pub(super) properties: Vec<Property>,
    /// Where it is declared.
    pub(super) line: u32,
}

/// A value of each row, or a list of values.
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// The kind of a list's length.
    pub(super) counted_by: Option<Kind>,
}

/// The kind of a value.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn of(word: &str) -> Result<Self, String> {
        Ok(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(format!("{} is no kind of value", excerpt(word))),
        })
    }
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, PlyError> {
        let mut elements: Vec<Element> = Vec::new();
        let (mut encoding, mut texture) = (None, None);
        let mut lines = Lines { rest: bytes, number: 0 };
        while let Some(text) = lines.next() {
            let line = lines.number;
            let wrong = |what| PlyError::Header { line, what };
            let (word, rest) = split(&text);
            match word {
                "ply" if line == 1 => {}
                "format" => encoding = Some(Encoding::of(rest).map_err(wrong)?),
                "comment" => texture = texture.or(rest.strip_prefix("TextureFile ").map(str::to_owned)),
                "obj_info" | "" => {}
                "element" => elements.push(Element::of(rest, line).map_err(wrong)?),
                "property" => {
                    let property = Property::of(rest).map_err(wrong)?;
                    let element = elements.last_mut();
                    let element = element.ok_or_else(|| wrong("it is before any element".to_owned()))?;
                    element.properties.push(property);
                }
                "end_header" => {
                    let encoding = encoding.ok_or_else(|| wrong("no line gives the format".to_owned()))?;
                    return Ok(Self {
                        encoding,
                        elements,
                        texture,
                        end: bytes.len() - lines.rest.len(),
                        line,
                    });
                }
                _ => return Err(wrong(format!("{} is unknown", excerpt(&text)))),
            }
        }
        let what = "the file ends before end_header".to_owned();
        Err(PlyError::Header { line: lines.number, what })
    }
}

impl Encoding {
    fn of(text: &str) -> Result<Self, String> {
        Ok(match split(text).0 {
            "ascii" => Self::Text,
            "binary_little_endian" => Self::LittleEndian,
            "binary_big_endian" => Self::BigEndian,
            _ => return Err(format!("{} is no format", excerpt(text))),
        })
    }
}

impl Element {
    fn of(text: &str, line: u32) -> Result<Self, String> {
        let (name, rows) = split(text);
        let rows = rows.parse().map_err(|_| format!("{} is no number of rows", excerpt(rows)))?;
        Ok(Self { name: name.to_owned(), rows, properties: Vec::new(), line })
    }
}

impl Property {
    fn of(text: &str) -> Result<Self, String> {
        let (first, rest) = split(text);
        if first != "list" {
            return Ok(Self { name: rest.to_owned(), kind: Kind::of(first)?, counted_by: None });
        }
        let (count, rest) = split(rest);
        let (kind, name) = split(rest);
        let counted_by = Some(Kind::of(count)?);
        Ok(Self { name: name.to_owned(), kind: Kind::of(kind)?, counted_by })
    }
}

/// The first word of a text and the rest.
fn split(text: &str) -> (&str, &str) {
    let text = text.trim_ascii();
    text.split_once(|letter: char| letter.is_ascii_whitespace())
        .map_or((text, ""), |(word, rest)| (word, rest.trim_ascii_start()))
}

/// The lines of a header. They end with LF, CRLF or CR.
struct Lines<'b> {
    rest: &'b [u8],
    number: u32,
}

impl Lines<'_> {
    fn next(&mut self) -> Option<String> {
        if self.rest.is_empty() {
            return None;
        }
        self.number = self.number.saturating_add(1);
        let end = self.rest.iter().position(|&byte| byte == b'\n' || byte == b'\r');
        let (line, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        let rest = rest.strip_prefix(b"\r\n").or_else(|| rest.get(1..));
        self.rest = rest.unwrap_or_default();
        Some(String::from_utf8_lossy(line).into_owned())
    }
}
