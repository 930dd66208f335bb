//! JSON as exporters write it: null for what is absent, and 5126.0 for 5126.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

/// A value whose default stands for null.
pub(super) fn or_default<'de, D, T>(json: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de> + Default,
{
    Ok(Option::deserialize(json)?.unwrap_or_default())
}

/// A whole number; null is 0.
pub(super) fn whole<'de, D, T>(json: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: TryFrom<u64> + Default,
{
    Ok(maybe_whole(json)?.unwrap_or_default())
}

/// A whole number, or none.
pub(super) fn maybe_whole<'de, D, T>(json: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: TryFrom<u64>,
{
    Option::<Whole>::deserialize(json)?.map(Whole::narrow).transpose()
}

/// Whole numbers; null is none.
pub(super) fn wholes<'de, D: Deserializer<'de>>(json: D) -> Result<Vec<u32>, D::Error> {
    let all = Option::<Vec<Narrow>>::deserialize(json)?.unwrap_or_default();
    Ok(all.into_iter().map(|Narrow(number)| number).collect())
}

/// Whole numbers with names; those that are null are left out.
pub(super) fn wholes_by_name<'de, D: Deserializer<'de>>(json: D) -> Result<BTreeMap<String, u32>, D::Error> {
    let all = Option::<BTreeMap<String, Option<Narrow>>>::deserialize(json)?.unwrap_or_default();
    Ok(all.into_iter().filter_map(|(name, number)| Some((name, number?.0))).collect())
}

/// A text; a number is taken as it stands.
pub(super) fn text<'de, D: Deserializer<'de>>(json: D) -> Result<Option<String>, D::Error> {
    Ok(match Option::<Value>::deserialize(json)? {
        None | Some(Value::Null) => None,
        Some(Value::String(text)) => Some(text),
        Some(other) => Some(other.to_string()),
    })
}

/// A number without a fraction, however it is written.
struct Whole(u64);

/// One that fits an index.
struct Narrow(u32);

impl Whole {
    fn narrow<T: TryFrom<u64>, E: Error>(self) -> Result<T, E> {
        T::try_from(self.0).map_err(|_| E::invalid_value(Unexpected::Unsigned(self.0), &"a smaller number"))
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

impl Visitor<'_> for Digits {
    type Value = Whole;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a whole number")
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Whole, E> {
        Ok(Whole(number))
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Whole, E> {
        // Up to here every whole number has a double of its own.
        const MOST: f64 = 9_007_199_254_740_992.0;
        if number.fract() == 0.0 && (0.0..=MOST).contains(&number) {
            Ok(Whole(number as u64))
        } else {
            Err(E::invalid_value(Unexpected::Float(number), &self))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(default)]
    struct All {
        #[serde(deserialize_with = "or_default")]
        flag: bool,
        #[serde(deserialize_with = "whole")]
        count: u64,
        #[serde(deserialize_with = "maybe_whole")]
        index: Option<u32>,
        #[serde(deserialize_with = "wholes")]
        children: Vec<u32>,
        #[serde(deserialize_with = "wholes_by_name")]
        attributes: BTreeMap<String, u32>,
        #[serde(deserialize_with = "text")]
        version: Option<String>,
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
    fn what_is_no_whole_number_is_refused() {
        for json in [r#"{"count":-1}"#, r#"{"count":1.5}"#, r#"{"count":1e300}"#, r#"{"index":4294967296}"#] {
            assert!(read(json).is_err(), "{json}");
        }
        assert!(read(r#"{"count":"1"}"#).unwrap_err().to_string().contains("a whole number"));
    }
}
