//! JSON in exporters' variants: null for absent values, and 5126.0 for 5126.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{Error, IgnoredAny, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

/// A member of an object in the JSON. Its type says how leniently it is read.
pub(super) trait Member: Sized {
    fn read<'de, D: Deserializer<'de>>(json: D) -> Result<Self, D::Error>;
}

/// Implements [`Member`] by a function for some types.
macro_rules! members {
    ($($read:path: $($kind:ty),+;)+) => {$($(
        impl $crate::import::gltf::lenient::Member for $kind {
            fn read<'de, D: serde::Deserializer<'de>>(json: D) -> std::result::Result<Self, D::Error> {
                $read(json)
            }
        }
    )+)+};
}

pub(super) use members;

members! {
    or_default: String, Vec<String>, Vec<IgnoredAny>, Option<Box<str>>, Option<IgnoredAny>, Option<Value>,
        Option<Box<Value>>;
    whole: u32, u64;
    maybe_whole: Option<u32>, Option<u64>;
    wholes: Vec<u32>;
    wholes_by_name: BTreeMap<String, u32>;
    maybe_signed: Option<i64>;
    text: Option<String>;
    maybe_flag: Option<bool>;
    flag: bool;
    real: Option<f32>;
    reals: Option<Box<[f32]>>;
    pair: Option<[f32; 2]>;
    colour: Option<[f32; 4]>;
}

impl<const N: usize> Member for Option<Box<[f64; N]>> {
    fn read<'de, D: Deserializer<'de>>(json: D) -> Result<Self, D::Error> {
        vector(json)
    }
}

/// A value whose default stands for null.
pub(super) fn or_default<'de, D, T>(json: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de> + Default,
{
    Ok(Option::deserialize(json)?.unwrap_or_default())
}

/// A whole number; null is 0.
fn whole<'de, D, T>(json: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: TryFrom<u64> + Default,
{
    match Whole::deserialize(json)? {
        Whole::Negative => Err(Error::custom("a negative number, expected a whole one")),
        number => Ok(number.narrow()?.unwrap_or_default()),
    }
}

/// A whole number, or none: null, or a negative one, which means none in many programs.
fn maybe_whole<'de, D, T>(json: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: TryFrom<u64>,
{
    Whole::deserialize(json)?.narrow()
}

/// Whole numbers, without those that mean none.
fn wholes<'de, D: Deserializer<'de>>(json: D) -> Result<Vec<u32>, D::Error> {
    let all = Option::<Vec<Narrow>>::deserialize(json)?.unwrap_or_default();
    Ok(all.into_iter().filter_map(|Narrow(number)| number).collect())
}

/// Whole numbers by name, without those that mean none.
fn wholes_by_name<'de, D: Deserializer<'de>>(json: D) -> Result<BTreeMap<String, u32>, D::Error> {
    let all = Option::<BTreeMap<String, Narrow>>::deserialize(json)?.unwrap_or_default();
    Ok(all.into_iter().filter_map(|(name, Narrow(number))| Some((name, number?))).collect())
}

/// A whole number that may be negative, or none.
fn maybe_signed<'de, D: Deserializer<'de>>(json: D) -> Result<Option<i64>, D::Error> {
    const MOST: f64 = Digits::MOST as f64;
    let value = Value::deserialize(json)?;
    let float = value.as_f64().filter(|float| float.fract() == 0.0 && (-MOST..=MOST).contains(float));
    match value.as_i64().or(float.map(|float| float as i64)) {
        None if !value.is_null() => Err(Error::custom(format!("{value}, expected a whole number"))),
        number => Ok(number),
    }
}

/// A text; a number is taken literally.
fn text<'de, D: Deserializer<'de>>(json: D) -> Result<Option<String>, D::Error> {
    Ok(match Option::<Value>::deserialize(json)? {
        None | Some(Value::Null) => None,
        Some(Value::String(text)) => Some(text),
        Some(other) => Some(other.to_string()),
    })
}

/// A boolean; languages without booleans write 0 and 1.
fn maybe_flag<'de, D: Deserializer<'de>>(json: D) -> Result<Option<bool>, D::Error> {
    match Value::deserialize(json)? {
        Value::Null => Ok(None),
        Value::Bool(flag) => Ok(Some(flag)),
        value if value == "true" || value.as_f64() == Some(1.0) => Ok(Some(true)),
        value if value == "false" || value.as_f64() == Some(0.0) => Ok(Some(false)),
        value => Err(Error::custom(format!("{value}, expected true or false"))),
    }
}

/// A boolean; false if absent.
fn flag<'de, D: Deserializer<'de>>(json: D) -> Result<bool, D::Error> {
    Ok(maybe_flag(json)?.unwrap_or_default())
}

/// An optional number. Other values become NaN: JavaScript writes NaN as null.
fn real<'de, D: Deserializer<'de>>(json: D) -> Result<Option<f32>, D::Error> {
    Ok(Option::<Real>::deserialize(json)?.map(|Real(number)| number as f32))
}

/// Numbers; other values become NaN.
fn reals<'de, D: Deserializer<'de>>(json: D) -> Result<Option<Box<[f32]>>, D::Error> {
    let all = Option::<Vec<Real>>::deserialize(json)?;
    Ok(all.map(|all| all.into_iter().map(|Real(number)| number as f32).collect()))
}

/// `N` numbers, or none. Other values become NaN, and so do all if the count is wrong.
fn vector<'de, D, const N: usize>(json: D) -> Result<Option<Box<[f64; N]>>, D::Error>
where
    D: Deserializer<'de>,
{
    let read = numbers::<D, N>(json)?;
    Ok(read.map(|(all, count)| Box::new(if count == N { all } else { [f64::NAN; N] })))
}

/// A pair of numbers, as [`vector`].
fn pair<'de, D: Deserializer<'de>>(json: D) -> Result<Option<[f32; 2]>, D::Error> {
    Ok(vector::<D, 2>(json)?.map(|pair| pair.map(|number| number as f32)))
}

/// A colour with optional alpha; otherwise as [`vector`].
fn colour<'de, D: Deserializer<'de>>(json: D) -> Result<Option<[f32; 4]>, D::Error> {
    let read = numbers::<D, 4>(json)?;
    Ok(read.map(|(all, count)| match (all.map(|number| number as f32), count) {
        ([r, g, b, _], 3) => [r, g, b, 1.0],
        (all, 4) => all,
        _ => [f32::NAN; 4],
    }))
}

/// A number without a fraction, in any notation.
enum Whole {
    Number(u64),
    Negative,
    Null,
}

/// One that fits an index, or none.
struct Narrow(Option<u32>);

impl Whole {
    fn narrow<T: TryFrom<u64>, E: Error>(self) -> Result<Option<T>, E> {
        let Self::Number(number) = self else { return Ok(None) };
        let narrow = T::try_from(number).map(Some);
        narrow.map_err(|_| E::invalid_value(Unexpected::Unsigned(number), &"a smaller number"))
    }
}

impl<'de> Deserialize<'de> for Narrow {
    fn deserialize<D: Deserializer<'de>>(json: D) -> Result<Self, D::Error> {
        Whole::deserialize(json)?.narrow().map(Narrow)
    }
}

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(json: D) -> Result<Self, D::Error> {
        json.deserialize_any(Digits)
    }
}

struct Digits;

impl Digits {
    /// Up to here every whole number is exact as a double.
    const MOST: u64 = 1 << 53;
}

impl Visitor<'_> for Digits {
    type Value = Whole;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a whole number")
    }

    fn visit_unit<E>(self) -> Result<Whole, E> {
        Ok(Whole::Null)
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Whole, E> {
        Ok(Whole::Number(number))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Whole, E> {
        Ok(u64::try_from(number).map_or(Whole::Negative, Whole::Number))
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Whole, E> {
        match number {
            _ if number.fract() != 0.0 || number > Self::MOST as f64 => {
                Err(E::invalid_value(Unexpected::Float(number), &self))
            }
            _ if number < 0.0 => Ok(Whole::Negative),
            _ => Ok(Whole::Number(number as u64)),
        }
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Whole, E> {
        match text.trim().parse() {
            Ok(number) => self.visit_f64(number),
            Err(_) => Err(E::invalid_value(Unexpected::Str(text), &self)),
        }
    }
}

/// A number; NaN for other values.
struct Real(f64);

impl<'de> Deserialize<'de> for Real {
    fn deserialize<D: Deserializer<'de>>(json: D) -> Result<Self, D::Error> {
        Ok(Self(number(&Value::deserialize(json)?)))
    }
}

fn number(value: &Value) -> f64 {
    let of_text = || value.as_str()?.trim().parse().ok();
    value.as_f64().or_else(of_text).unwrap_or(f64::NAN)
}

/// The first `N` numbers of a list, and its length; none of an absent or empty one.
fn numbers<'de, D, const N: usize>(json: D) -> Result<Option<([f64; N], usize)>, D::Error>
where
    D: Deserializer<'de>,
{
    let mut all = [f64::NAN; N];
    let count = match Value::deserialize(json)? {
        Value::Null => 0,
        Value::Array(list) => {
            all.iter_mut().zip(&list).for_each(|(place, value)| *place = number(value));
            list.len()
        }
        // JavaScript's form of typed arrays: `{"0":1,"1":2}`.
        Value::Object(list) => {
            for (key, value) in &list {
                if let Some(place) = key.parse::<usize>().ok().and_then(|index| all.get_mut(index)) {
                    *place = number(value);
                }
            }
            list.len()
        }
        _ => N,
    };
    Ok((count > 0).then_some((all, count)))
}

#[cfg(test)]
mod tests {
    use super::super::objects::objects;
    use super::*;

    objects! {
        #[derive(PartialEq)]
        struct All {
            flag: bool,
            count: u64,
            index: Option<u32>,
            children: Vec<u32>,
            attributes: BTreeMap<String, u32>,
            version: Option<String>,
            place: Option<Box<[f64; 3]>>,
        }
    }

    fn read(json: &str) -> serde_json::Result<All> {
        serde_json::from_str(json)
    }

    #[test]
    fn null_is_as_if_it_were_not_there() {
        let json =
            r#"{"flag":null,"count":null,"index":null,"children":null,"attributes":null,"version":null}"#;
        assert_eq!(read(json).unwrap(), All::default());
        assert_eq!(read(r#"{"attributes":{"POSITION":null}}"#).unwrap(), All::default());
    }

    #[test]
    fn whole_numbers_may_be_written_as_floats() {
        let json = r#"{"count":5126.0,"index":1e3,"children":[0.0,7],"attributes":{"A":2.0},"version":2.0}"#;
        let all = read(json).unwrap();
        assert_eq!((all.count, all.index, &*all.children), (5126, Some(1000), &[0, 7][..]));
        assert_eq!((all.attributes.get("A"), all.version.as_deref()), (Some(&2), Some("2.0")));
    }

    #[test]
    fn numbers_and_truths_may_be_texts_and_what_is_no_number_is_nan() {
        let all = read(r#"{"flag":1,"count":"3","place":{"0":1,"1":"2.5","2":3}}"#).unwrap();
        assert_eq!((all.flag, all.count, all.place.as_deref()), (true, 3, Some(&[1.0, 2.5, 3.0])));
        for place in ["[1,null,3]", "[1,2]", "[1,2,3,4]", r#""1 2 3""#, "[1,[2],3]", "7"] {
            let all = read(&format!(r#"{{"place":{place}}}"#)).unwrap();
            assert!(all.place.unwrap().iter().any(|number| number.is_nan()), "{place}");
        }
        for place in ["null", "[]", "{}"] {
            assert_eq!(read(&format!(r#"{{"place":{place}}}"#)).unwrap(), All::default());
        }
        assert!(read(r#"{"flag":"perhaps"}"#).is_err());
    }

    #[test]
    fn what_is_no_whole_number_is_refused() {
        assert_eq!(read(r#"{"index":-1,"children":[-1,2,null]}"#).unwrap().children, [2]);
        for json in [r#"{"count":-1}"#, r#"{"count":1.5}"#, r#"{"count":1e300}"#, r#"{"index":4294967296}"#] {
            assert!(read(json).is_err(), "{json}");
        }
        assert!(read(r#"{"count":"one"}"#).unwrap_err().to_string().contains("a whole number"));
    }
}
