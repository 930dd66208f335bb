//! A column of a property table: packed values of one type.

use serde_json::{Number, Value};

use super::accessor::Accessors;
use super::metadata::{Enumeration, Property};
use super::objects::objects;

type Result<T> = std::result::Result<T, &'static str>;

objects! {
    pub(super) struct Column {
        /// Views of the bytes.
        values: u32,
        array_offsets: Option<u32>,
        string_offsets: Option<u32>,
        array_offset_type: Option<String>,
        string_offset_type: Option<String>,
        /// Replaces the property's.
        offset: Option<Value>,
        scale: Option<Value>,
    }
}

/// The most numbers of a value: a row is shown as one line in a page.
const MOST_NUMBERS: u64 = 4_096;

/// The type of a number.
#[derive(Clone, Copy)]
enum Kind {
    Signed(usize),
    Unsigned(usize),
    Float(usize),
}

impl Column {
    /// The value in a row.
    pub(super) fn value(
        &self,
        accessors: &Accessors<'_>,
        property: &Property,
        names: Option<&Enumeration>,
        row: u64,
    ) -> Result<Value> {
        let bytes = accessors.view_bytes(self.values)?;
        let element = |at: u64| self.element(accessors, bytes, property, names, at);
        if !property.array {
            return element(row);
        }
        let (start, end) = match (property.count, self.array_offsets) {
            (Some(count), _) => (row.saturating_mul(count), row.saturating_add(1).saturating_mul(count)),
            (None, Some(view)) => span(accessors, view, self.array_offset_type.as_deref(), row)?,
            (None, None) => return Err("its arrays have no lengths"),
        };
        if end.saturating_sub(start) > MOST_NUMBERS {
            return Err("its arrays are too long");
        }
        (start..end).map(element).collect::<Result<Vec<_>>>().map(Value::Array)
    }

    /// A value that is no array.
    fn element(
        &self,
        accessors: &Accessors<'_>,
        bytes: &[u8],
        property: &Property,
        names: Option<&Enumeration>,
        at: u64,
    ) -> Result<Value> {
        let lanes = match property.kind.as_str() {
            "STRING" => {
                let view = self.string_offsets.ok_or("its texts have no lengths")?;
                let (start, end) = span(accessors, view, self.string_offset_type.as_deref(), at)?;
                let text = bytes.get(start as usize..end as usize).ok_or("a text reaches past its end")?;
                return Ok(Value::String(String::from_utf8_lossy(text).into_owned()));
            }
            "BOOLEAN" => {
                let byte = bytes.get((at / 8) as usize).ok_or("it has too few values")?;
                return Ok(Value::Bool((byte >> (at % 8)) & 1 == 1));
            }
            "ENUM" => {
                let names = names.ok_or("its names are not in the schema")?;
                let kind = Kind::new(names.value_type.as_deref().unwrap_or("UINT16"))?;
                let number = kind.read(bytes, at)?;
                let known =
                    names.values.iter().find(|known| known.value.is_some() && number.as_i64() == known.value);
                return Ok(known.map_or(Value::Number(number), |known| Value::String(known.name.clone())));
            }
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" | "MAT2" => 4,
            "MAT3" => 9,
            "MAT4" => 16,
            _ => return Err("its type is unknown"),
        };
        let kind = Kind::new(property.component_type.as_deref().ok_or("it has no component type")?)?;
        let numbers = (0..lanes).map(|lane| {
            let number = kind.read(bytes, at.saturating_mul(lanes).saturating_add(lane))?;
            Ok(Value::Number(self.scaled(number, kind, property, lane as usize)))
        });
        let mut numbers = numbers.collect::<Result<Vec<_>>>()?;
        Ok(if lanes == 1 { numbers.swap_remove(0) } else { Value::Array(numbers) })
    }

    /// A number with its property's normalization, scale and offset.
    fn scaled(&self, number: Number, kind: Kind, property: &Property, lane: usize) -> Number {
        let of = |own: &Option<Value>, all: &Option<Value>| {
            let value = own.as_ref().or(all.as_ref())?;
            value.as_f64().or_else(|| value.get(lane)?.as_f64())
        };
        let scale = of(&self.scale, &property.scale);
        let offset = of(&self.offset, &property.offset);
        if scale.is_none() && offset.is_none() && !property.normalized {
            return number;
        }
        let mut value = number.as_f64().unwrap_or_default();
        if property.normalized {
            value = (value / kind.largest()).max(-1.0);
        }
        Number::from_f64(value * scale.unwrap_or(1.0) + offset.unwrap_or(0.0)).unwrap_or(number)
    }
}

/// The range of a value of variable length.
fn span(accessors: &Accessors<'_>, view: u32, kind: Option<&str>, at: u64) -> Result<(u64, u64)> {
    let (bytes, kind) = (accessors.view_bytes(view)?, Kind::new(kind.unwrap_or("UINT32"))?);
    let offset = |at| kind.read(bytes, at)?.as_u64().ok_or("an offset is no whole number");
    let (start, end) = (offset(at)?, offset(at.saturating_add(1))?);
    if start <= end { Ok((start, end)) } else { Err("its offsets do not ascend") }
}

impl Kind {
    fn new(name: &str) -> Result<Self> {
        Ok(match name {
            "INT8" => Self::Signed(1),
            "INT16" => Self::Signed(2),
            "INT32" => Self::Signed(4),
            "INT64" => Self::Signed(8),
            "UINT8" => Self::Unsigned(1),
            "UINT16" => Self::Unsigned(2),
            "UINT32" => Self::Unsigned(4),
            "UINT64" => Self::Unsigned(8),
            "FLOAT32" => Self::Float(4),
            "FLOAT64" => Self::Float(8),
            _ => return Err("its component type is unknown"),
        })
    }

    /// The value for 1 in normalized numbers.
    fn largest(self) -> f64 {
        match self {
            Self::Signed(size) => 2f64.powi(8 * size as i32 - 1) - 1.0,
            Self::Unsigned(size) => 2f64.powi(8 * size as i32) - 1.0,
            Self::Float(_) => 1.0,
        }
    }

    /// The number at an index.
    fn read(self, bytes: &[u8], at: u64) -> Result<Number> {
        let (Self::Signed(size) | Self::Unsigned(size) | Self::Float(size)) = self;
        let start = usize::try_from(at).ok().and_then(|at| at.checked_mul(size));
        let bytes = start.and_then(|start| bytes.get(start..start.checked_add(size)?));
        let mut eight = [0; 8];
        eight
            .get_mut(..size)
            .ok_or("it has too few values")?
            .copy_from_slice(bytes.ok_or("it has too few values")?);
        let number = u64::from_le_bytes(eight);
        let unused = 64 - 8 * size as u32;
        match self {
            Self::Unsigned(_) => Ok(number.into()),
            Self::Signed(_) => Ok(((number << unused).cast_signed() >> unused).into()),
            Self::Float(4) => {
                Number::from_f64(f32::from_bits(number as u32).into()).ok_or("a number is not finite")
            }
            Self::Float(_) => Number::from_f64(f64::from_bits(number)).ok_or("a number is not finite"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::buffers::Bytes;
    use super::super::json::Document;
    use super::*;

    /// The values of all rows of a column over views 0 (values), 1 (text offsets) and 2 (array offsets).
    fn values(property: &str, column: &str, rows: u64, views: [&[u8]; 3]) -> Vec<Result<Value>> {
        let bytes = views.concat();
        let (mut offset, mut texts) = (0, Vec::new());
        for view in views {
            texts.push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{}}}"#, view.len()));
            offset += view.len();
        }
        let json = format!(r#"{{"bufferViews":[{}]}}"#, texts.join(","));
        let document: Document = serde_json::from_str(&json).unwrap();
        let buffers = [Bytes::Within(&bytes)];
        let accessors = Accessors::new(&document, &buffers, &[]);
        let property: Property = serde_json::from_str(property).unwrap();
        let column: Column = serde_json::from_str(column).unwrap();
        let names = serde_json::from_str(
            r#"{"valueType":"INT8","values":[{"name":"open","value":1},{"name":"shut","value":-1}]}"#,
        )
        .unwrap();
        (0..rows).map(|row| column.value(&accessors, &property, Some(&names), row)).collect()
    }

    fn all(property: &str, column: &str, rows: u64, views: [&[u8]; 3]) -> String {
        let values =
            values(property, column, rows, views).into_iter().map(|value| value.unwrap().to_string());
        values.collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn values_of_every_type_are_read() {
        let none: &[u8] = &[];
        let strings = [b"P-1Beh\xc3\xa4lter".as_slice(), &[0, 3, 12], none];
        let offsets = r#"{"values":0,"stringOffsets":1,"stringOffsetType":"UINT8"}"#;
        assert_eq!(all(r#"{"type":"STRING"}"#, offsets, 2, strings), r#""P-1" "Behälter""#);
        let plain = r#"{"values":0}"#;
        assert_eq!(all(r#"{"type":"BOOLEAN"}"#, plain, 3, [&[0b101], none, none]), "true false true");
        let states = [&[1, 255, 7][..], none, none];
        assert_eq!(all(r#"{"type":"ENUM","enumType":"e"}"#, plain, 3, states), r#""open" "shut" 7"#);
        let short = r#"{"type":"SCALAR","componentType":"INT16"}"#;
        assert_eq!(all(short, plain, 2, [&[0xff, 0xff, 0, 1], none, none]), "-1 256");
        let vector = r#"{"type":"VEC2","componentType":"UINT8"}"#;
        assert_eq!(all(vector, plain, 2, [&[1, 2, 3, 4], none, none]), "[1,2] [3,4]");
        let real = r#"{"type":"SCALAR","componentType":"FLOAT32"}"#;
        assert_eq!(all(real, plain, 1, [&1.5f32.to_le_bytes(), none, none]), "1.5");
        let scaled = r#"{"type":"SCALAR","componentType":"UINT8","normalized":true,"scale":10,"offset":5}"#;
        assert_eq!(all(scaled, plain, 2, [&[255, 0], none, none]), "15.0 5.0");
        assert_eq!(all(scaled, r#"{"values":0,"offset":0}"#, 1, [&[255], none, none]), "10.0");
    }

    #[test]
    fn arrays_have_one_length_or_their_own() {
        let none: &[u8] = &[];
        let fixed = r#"{"type":"SCALAR","componentType":"UINT8","array":true,"count":2}"#;
        assert_eq!(all(fixed, r#"{"values":0}"#, 2, [&[1, 2, 3, 4], none, none]), "[1,2] [3,4]");
        let own = r#"{"type":"STRING","array":true}"#;
        let column = r#"{"values":0,"stringOffsets":1,"stringOffsetType":"UINT8","arrayOffsets":2,"arrayOffsetType":"UINT16"}"#;
        let views = [b"abc".as_slice(), &[0, 1, 1, 3], &[0, 0, 3, 0, 3, 0]];
        assert_eq!(all(own, column, 2, views), r#"["a","","bc"] []"#);
    }

    #[test]
    fn what_is_malformed_is_an_error() {
        let none: &[u8] = &[];
        let text = r#"{"type":"STRING"}"#;
        let offsets = r#"{"values":0,"stringOffsets":1,"stringOffsetType":"UINT8"}"#;
        for (property, column, views) in [
            (text, r#"{"values":0}"#, [b"ab".as_slice(), none, none]),
            (text, r#"{"values":9}"#, [b"ab", none, none]),
            (text, offsets, [b"ab", &[0, 9], none]),
            (text, offsets, [b"ab", &[2, 1], none]),
            (text, offsets, [b"ab", &[2], none]),
            (r#"{"type":"SCALAR"}"#, r#"{"values":0}"#, [b"ab", none, none]),
            (r#"{"type":"SCALAR","componentType":"FLOAT64"}"#, r#"{"values":0}"#, [b"ab", none, none]),
            (r#"{"type":"SCALAR","componentType":"FLOAT32"}"#, r#"{"values":0}"#, [&[255; 4], none, none]),
            (r#"{"type":"MAT4","componentType":"INT8"}"#, r#"{"values":0}"#, [b"ab", none, none]),
            (r#"{"type":"OTHER","componentType":"INT8"}"#, r#"{"values":0}"#, [b"ab", none, none]),
            (
                r#"{"type":"SCALAR","componentType":"INT8","array":true}"#,
                r#"{"values":0}"#,
                [b"ab", none, none],
            ),
            (
                r#"{"type":"SCALAR","componentType":"INT8","array":true,"count":18446744073709551615}"#,
                r#"{"values":0}"#,
                [b"ab", none, none],
            ),
        ] {
            assert!(values(property, column, 1, views)[0].is_err(), "{property} {column}");
        }
    }
}
