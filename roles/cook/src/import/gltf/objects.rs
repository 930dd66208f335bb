//! Objects of the JSON as structs, whose members are read leniently.

use std::marker::PhantomData;
use std::{fmt, mem};

use serde::Deserializer;
use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, Visitor};

use super::lenient::Member;

/// A struct that is an object in the JSON. Derived implementations of `Deserialize` are several times as much
/// code, for each reader of JSON once more.
pub(super) trait Object: Default {
    /// The names of its members, in snake case. Those with capital letters are exact.
    const MEMBERS: &'static [&'static str];

    /// Reads the value of the member with this index.
    fn read<'de, A: MapAccess<'de>>(&mut self, index: usize, map: &mut A) -> Result<(), A::Error>;
}

/// Structs as in the JSON: each member is read as its type says, and is its default if it is absent. It is
/// named in the JSON as here, in camel case, or as the text behind its type says.
macro_rules! objects {
    ($(
        $(#[$about:meta])*
        $seen:vis struct $name:ident {
            $($(#[$of:meta])* $open:vis $member:ident: $kind:ty $(= $json:literal)?,)+
        }
    )+) => {$(
        $(#[$about])*
        #[derive(Debug, Default)]
        $seen struct $name { $($(#[$of])* $open $member: $kind,)+ }

        impl $crate::import::gltf::objects::Object for $name {
            const MEMBERS: &'static [&'static str] =
                &[$($crate::import::gltf::objects::objects!(@name $member $($json)?),)+];

            fn read<'de, A: serde::de::MapAccess<'de>>(
                &mut self,
                index: usize,
                map: &mut A,
            ) -> std::result::Result<(), A::Error> {
                let mut indices = 0..;
                $(if indices.next() == Some(index) {
                    self.$member = $crate::import::gltf::objects::next(map)?;
                })+
                Ok(())
            }
        }

        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(json: D) -> std::result::Result<Self, D::Error> {
                json.deserialize_map($crate::import::gltf::objects::Members(std::marker::PhantomData))
            }
        }

        $crate::import::gltf::lenient::members! {
            $crate::import::gltf::lenient::or_default: $name, Option<$name>, Option<Box<$name>>, Vec<$name>,
                std::collections::BTreeMap<String, $name>;
        }
    )+};
    (@name $member:ident) => { stringify!($member) };
    (@name $member:ident $json:literal) => { $json };
}

pub(super) use objects;

/// The members of an object.
pub(super) struct Members<T>(pub PhantomData<T>);

impl<'de, T: Object> Visitor<'de> for Members<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    /// Of a duplicate member, the last one counts.
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<T, A::Error> {
        let mut object = T::default();
        while let Some(known) = map.next_key_seed(Key(T::MEMBERS))? {
            match known {
                Some(index) => object.read(index, &mut map)?,
                None => drop(map.next_value::<IgnoredAny>()?),
            }
        }
        Ok(object)
    }
}

/// The next value of an object.
pub(super) fn next<'de, A: MapAccess<'de>, T: Member>(map: &mut A) -> Result<T, A::Error> {
    map.next_value_seed(AsMember(PhantomData))
}

struct AsMember<T>(PhantomData<T>);

impl<'de, T: Member> DeserializeSeed<'de> for AsMember<T> {
    type Value = T;

    fn deserialize<D: Deserializer<'de>>(self, json: D) -> Result<T, D::Error> {
        T::read(json)
    }
}

/// A key: its index among names, if it is one of them.
struct Key(&'static [&'static str]);

impl<'de> DeserializeSeed<'de> for Key {
    type Value = Option<usize>;

    fn deserialize<D: Deserializer<'de>>(self, json: D) -> Result<Option<usize>, D::Error> {
        json.deserialize_identifier(self)
    }
}

impl Visitor<'_> for Key {
    type Value = Option<usize>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a name")
    }

    fn visit_str<E>(self, key: &str) -> Result<Option<usize>, E> {
        Ok(self.0.iter().position(|name| is_called(name, key)))
    }
}

/// Whether a member of this name, in snake case or exact, has this key in the JSON.
fn is_called(name: &str, key: &str) -> bool {
    if name.bytes().any(|letter| letter.is_ascii_uppercase()) {
        return name == key;
    }
    let mut begins = false;
    let camel = name.bytes().filter_map(|letter| match (letter, mem::take(&mut begins)) {
        (b'_', _) => {
            begins = true;
            None
        }
        (letter, true) => Some(letter.to_ascii_uppercase()),
        (letter, false) => Some(letter),
    });
    camel.eq(key.bytes())
}

#[cfg(test)]
mod tests {
    #[test]
    fn members_are_called_in_camel_case_or_exactly_and_the_last_of_two_counts() {
        objects! {
            struct Called { buffer_view: u32, kind: u32 = "type", position: u32 = "EXT_a_position", }
        }
        let json =
            r#"{"bufferView":1,"buffer_view":9,"type":2,"EXT_a_position":3,"kind":9,"EXTAPosition":9}"#;
        let called: Called = serde_json::from_str(json).unwrap();
        assert_eq!((called.buffer_view, called.kind, called.position), (1, 2, 3));
        let called: Called = serde_json::from_str(r#"{"type":1,"type":2}"#).unwrap();
        assert_eq!(called.kind, 2);
        let refused = serde_json::from_str::<Called>("[1,2,3]").unwrap_err().to_string();
        assert!(refused.contains("invalid type: sequence, expected an object"), "{refused}");
    }
}
