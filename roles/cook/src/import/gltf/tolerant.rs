//! Reads a document with a faulty part, losing only that part.
//!
//! This reads documents that the strict reader has refused. It goes item by item (a node, a mesh, an
//! accessor), so that no more than one item is in memory as plain JSON.

use std::fmt;

use serde::Deserializer;
use serde::de::{DeserializeOwned, DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use serde_path_to_error::{Path, Segment};

use super::GltfError;
use super::faults::Faults;
use super::json::Document;
use crate::import::report::WarningKind;

/// Reads a document as far as possible; fails if it is no JSON, or no object.
pub(super) fn read(json: &[u8], faults: &mut Faults) -> serde_json::Result<Document> {
    let mut reader = serde_json::Deserializer::from_slice(json);
    reader.deserialize_map(Members(faults))
}

/// How many values of an item are repaired; an item with more faults is left out.
const MOST_MENDED: usize = 64;
/// How many values a repaired item may have: repairing reads it several times.
const MOST_VALUES: usize = 100_000;

/// Notes that the value at `path` within an item is faulty.
fn note(faults: &mut Faults, item: &str, path: &str, why: &str) {
    let detail = if path == "." { why.to_owned() } else { format!("{path}: {why}") };
    faults.note(WarningKind::FieldLeftOut, &detail, item);
    faults.cause(|| GltfError::Malformed { part: item.to_owned(), what: detail });
}

/// The members of a document.
struct Members<'f>(&'f mut Faults);

impl<'de> Visitor<'de> for Members<'_> {
    type Value = Document;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a glTF document")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Document, A::Error> {
        let mut all = Document::default();
        let faults = &mut *self.0;
        // Of a duplicate member, the last one counts.
        while let Some(key) = map.next_key::<String>()? {
            match &*key {
                "scenes" => all.scenes = map.next_value_seed(Items::piecewise("scene", faults))?,
                "nodes" => all.nodes = map.next_value_seed(Items::piecewise("node", faults))?,
                "meshes" => all.meshes = map.next_value_seed(Items::piecewise("mesh", faults))?,
                "materials" => all.materials = map.next_value_seed(Items::piecewise("material", faults))?,
                "textures" => all.textures = map.next_value_seed(Items::piecewise("texture", faults))?,
                "samplers" => all.samplers = map.next_value_seed(Items::piecewise("sampler", faults))?,
                "images" => all.images = map.next_value_seed(Items::piecewise("image", faults))?,
                "accessors" => all.accessors = map.next_value_seed(Items::whole("accessor", faults))?,
                "bufferViews" => {
                    all.buffer_views = map.next_value_seed(Items::whole("buffer view", faults))?;
                }
                "buffers" => all.buffers = map.next_value_seed(Items::whole("buffer", faults))?,
                "asset" | "scene" | "extensions" | "extensionsRequired" => {
                    let member = Value::Object(Map::from_iter([(key.clone(), map.next_value()?)]));
                    let one: Document = mended(member, "the document", true, faults);
                    match &*key {
                        "asset" => all.asset = one.asset,
                        "scene" => all.scene = one.scene,
                        "extensions" => all.extensions = one.extensions,
                        _ => all.extensions_required = one.extensions_required,
                    }
                }
                _ => {
                    map.next_value::<IgnoredAny>()?;
                }
            }
        }
        Ok(all)
    }
}

/// A list of items.
struct Items<'f, T> {
    item: &'static str,
    /// Whether a faulty value within an item can be left out without changing the meaning of the rest.
    piecewise: bool,
    faults: &'f mut Faults,
    items: Vec<T>,
}

impl<'f, T> Items<'f, T> {
    fn piecewise(item: &'static str, faults: &'f mut Faults) -> Self {
        Self { item, piecewise: true, faults, items: Vec::new() }
    }

    fn whole(item: &'static str, faults: &'f mut Faults) -> Self {
        Self { item, piecewise: false, faults, items: Vec::new() }
    }
}

impl<'de, T: DeserializeOwned + Default> DeserializeSeed<'de> for Items<'_, T> {
    type Value = Vec<T>;

    fn deserialize<D: Deserializer<'de>>(self, json: D) -> Result<Vec<T>, D::Error> {
        json.deserialize_any(self)
    }
}

impl<'de, T: DeserializeOwned + Default> Visitor<'de> for Items<'_, T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list: each {}", self.item)
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut list: A) -> Result<Vec<T>, A::Error> {
        while let Some(value) = list.next_element::<Value>()? {
            let item = format!("{} {}", self.item, self.items.len());
            self.items.push(mended(value, &item, self.piecewise, self.faults));
        }
        Ok(self.items)
    }

    /// Some languages have only one kind of empty list.
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Vec<T>, A::Error> {
        let mut count = 0u64;
        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {
            count += 1;
        }
        if count > 0 {
            note(self.faults, &format!("each {}", self.item), ".", "a list was expected");
        }
        Ok(self.items)
    }

    fn visit_unit<E>(self) -> Result<Vec<T>, E> {
        Ok(self.items)
    }

    fn visit_bool<E: Error>(self, _: bool) -> Result<Vec<T>, E> {
        note(self.faults, &format!("each {}", self.item), ".", "a list was expected");
        Ok(self.items)
    }

    fn visit_f64<E: Error>(self, _: f64) -> Result<Vec<T>, E> {
        self.visit_bool(false)
    }

    fn visit_u64<E: Error>(self, _: u64) -> Result<Vec<T>, E> {
        self.visit_bool(false)
    }

    fn visit_i64<E: Error>(self, _: i64) -> Result<Vec<T>, E> {
        self.visit_bool(false)
    }

    fn visit_str<E: Error>(self, _: &str) -> Result<Vec<T>, E> {
        self.visit_bool(false)
    }
}

/// An item without its faulty values.
fn mended<T: DeserializeOwned + Default>(
    mut value: Value,
    item: &str,
    piecewise: bool,
    faults: &mut Faults,
) -> T {
    if value.is_null() {
        return T::default();
    }
    let piecewise = piecewise && values(&value) <= MOST_VALUES;
    let name = value.get("name").and_then(Value::as_str).map(|name| format!("{item} ({name})"));
    let mut last = None;
    for _ in 0..MOST_MENDED {
        let why = match serde_path_to_error::deserialize(&value) {
            Ok(item) => return item,
            Err(why) => why,
        };
        let path = why.path().clone();
        let place = path.to_string();
        if last.as_ref() != Some(&place) {
            note(faults, name.as_deref().unwrap_or(item), &unnumbered(&path), &why.inner().to_string());
        }
        if !piecewise || !leave_out(&mut value, &path) {
            break;
        }
        last = Some(place);
    }
    T::default()
}

/// How many values it contains.
fn values(value: &Value) -> usize {
    1 + match value {
        Value::Array(all) => all.iter().map(values).sum(),
        Value::Object(all) => all.values().map(values).sum(),
        _ => 0,
    }
}

/// A path for messages: without numbers, so that a thousandfold error is one fault.
fn unnumbered(path: &Path) -> String {
    let mut names = Vec::new();
    for segment in path {
        if let Segment::Map { key } = segment {
            names.push(key.as_str());
        }
    }
    if names.is_empty() { ".".to_owned() } else { names.join(".") }
}

/// Removes the value at a path: sets it to null, or, if null is there and still faulty, to an empty object,
/// or else removes its container. Returns whether anything was removed.
fn leave_out(value: &mut Value, path: &Path) -> bool {
    let mut segments: Vec<&Segment> = path.iter().collect();
    while !segments.is_empty() {
        let mut at = Some(&mut *value);
        for segment in &segments {
            at = match segment {
                Segment::Seq { index } => at.and_then(|at| at.get_mut(*index)),
                Segment::Map { key } => at.and_then(|at| at.get_mut(key)),
                _ => None,
            };
        }
        match at {
            Some(at) if at.is_null() => {
                *at = Value::Object(Map::new());
                return true;
            }
            Some(at) if at.as_object().is_none_or(|members| !members.is_empty()) => {
                *at = Value::Null;
                return true;
            }
            _ => segments.pop(),
        };
    }
    false
}
