//! The values behind a PLY file's header.

use super::PlyError;
use super::header::{Element, Encoding, Header, Kind, Property};
use crate::import::FilePosition;
use crate::import::text::excerpt;

/// The values that are not read yet.
pub(super) struct Values<'b> {
    rest: &'b [u8],
    length: usize,
    encoding: Encoding,
    /// The current line of text.
    line: u32,
}

/// A row: the values that a walk needs, by their places in [`Row::NAMES`], and a list.
pub(super) struct Row {
    pub(super) values: [f64; Self::NAMES.len()],
    pub(super) list: Vec<f64>,
}

impl Row {
    /// The names of the values that are kept.
    pub(super) const NAMES: [&[&str]; 7] = [
        &["x"],
        &["y"],
        &["z"],
        &["red", "r", "diffuse_red"],
        &["green", "g", "diffuse_green"],
        &["blue", "b", "diffuse_blue"],
        &["alpha", "a", "diffuse_alpha"],
    ];
    /// The names of the list that is kept.
    const LIST: [&str; 2] = ["vertex_indices", "vertex_index"];
}

/// The use of a property.
#[derive(Clone, Copy)]
enum Use {
    Value(usize),
    List,
    None,
}

impl Use {
    fn of(property: &Property) -> Self {
        let name = property.name.as_str();
        if property.counted_by.is_some() {
            return if Row::LIST.contains(&name) { Self::List } else { Self::None };
        }
        Row::NAMES.iter().position(|names| names.contains(&name)).map_or(Self::None, Self::Value)
    }
}

/// Why a value could not be read.
enum Wrong {
    Cut,
    Value(String),
}

impl<'b> Values<'b> {
    pub(super) fn of(bytes: &'b [u8], header: &Header) -> Self {
        let rest = bytes.get(header.end..).unwrap_or_default();
        let line = header.line.saturating_add(1);
        Self { rest, length: bytes.len(), encoding: header.encoding, line }
    }

    /// Reads the rows of the next element. `each` gets their numbers, from 1 on.
    pub(super) fn rows(
        &mut self,
        element: &Element,
        mut each: impl FnMut(u64, &Row),
    ) -> Result<(), PlyError> {
        let Element { name, rows, properties, .. } = element;
        // Such rows take no bytes, so there may be any number of them.
        if properties.is_empty() {
            return Ok(());
        }
        let uses: Vec<Use> = properties.iter().map(Use::of).collect();
        let mut row = Row { values: [f64::NAN; Row::NAMES.len()], list: Vec::new() };
        for number in 1..=*rows {
            for (property, used) in properties.iter().zip(&uses) {
                self.property(property, *used, &mut row).map_err(|wrong| {
                    let (at, element) = (self.at(), name.clone());
                    match wrong {
                        Wrong::Cut => PlyError::Cut { at, element, row: number, rows: *rows },
                        Wrong::Value(what) => PlyError::Value { at, element, row: number, what },
                    }
                })?;
            }
            each(number, &row);
        }
        Ok(())
    }

    /// How many bytes are left, except for white space behind text.
    pub(super) fn behind(&self) -> usize {
        match self.encoding {
            Encoding::Text => self.rest.trim_ascii().len(),
            _ => self.rest.len(),
        }
    }

    fn property(&mut self, property: &Property, used: Use, row: &mut Row) -> Result<(), Wrong> {
        let Some(counted_by) = property.counted_by else {
            let value = self.value(property.kind)?;
            if let Use::Value(place) = used {
                crate::lists::put(&mut row.values, place, value);
            }
            return Ok(());
        };
        let count = self.value(counted_by)?;
        if count < 0.0 || count.fract() != 0.0 {
            return Err(Wrong::Value(format!("{count} is no length of a list")));
        }
        let is_kept = matches!(used, Use::List);
        if is_kept {
            row.list.clear();
        }
        // The cast clamps.
        for _ in 0..count as u64 {
            let value = self.value(property.kind)?;
            if is_kept {
                row.list.push(value);
            }
        }
        Ok(())
    }

    fn at(&self) -> FilePosition {
        match self.encoding {
            Encoding::Text => FilePosition::Line(self.line.into()),
            _ => FilePosition::Byte((self.length - self.rest.len()) as u64),
        }
    }

    fn value(&mut self, kind: Kind) -> Result<f64, Wrong> {
        if self.encoding == Encoding::Text {
            return self.word();
        }
        Ok(match kind {
            Kind::I8 => i8::from_le_bytes(self.bytes()?).into(),
            Kind::U8 => u8::from_le_bytes(self.bytes()?).into(),
            Kind::I16 => i16::from_le_bytes(self.bytes()?).into(),
            Kind::U16 => u16::from_le_bytes(self.bytes()?).into(),
            Kind::I32 => i32::from_le_bytes(self.bytes()?).into(),
            Kind::U32 => u32::from_le_bytes(self.bytes()?).into(),
            Kind::F32 => f32::from_le_bytes(self.bytes()?).into(),
            Kind::F64 => f64::from_le_bytes(self.bytes()?),
        })
    }

    /// The bytes of the next value, the lowest first.
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Wrong> {
        let (&(mut bytes), rest) = self.rest.split_first_chunk().ok_or(Wrong::Cut)?;
        self.rest = rest;
        if self.encoding == Encoding::BigEndian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn word(&mut self) -> Result<f64, Wrong> {
        let start = self.rest.iter().position(|byte| !byte.is_ascii_whitespace()).ok_or(Wrong::Cut)?;
        let (space, rest) = self.rest.split_at(start);
        let lines = space.iter().filter(|&&byte| byte == b'\n').count();
        self.line = self.line.saturating_add(lines as u32);
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.rest = rest;
        let word = String::from_utf8_lossy(word);
        // Programs on Windows write numbers that are none as `1.#IND` and `-nan(ind)`.
        let is_none = || word.contains(".#") || word.to_ascii_lowercase().contains("nan(");
        match word.parse() {
            Ok(value) => Ok(value),
            Err(_) if is_none() => Ok(f64::NAN),
            Err(_) => Err(Wrong::Value(format!("{} is no number", excerpt(&word)))),
        }
    }
}
