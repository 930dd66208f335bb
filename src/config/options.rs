//! The options of links: every key of `trimaran_transport::Options`, by file, environment and flag.
//!
//! The field of a key says its name, its meaning and its default; nothing of that is repeated here.

use std::str::FromStr;

use schemars::generate::SchemaSettings;
use serde::Deserialize;
use serde_json::Value as Json;
use thiserror::Error;
use toml::{Table, Value};
use trimaran_transport::Options;

use super::ConfigError;

/// A key of [`Options`].
#[derive(Debug, Clone, PartialEq)]
pub struct OptionKey {
    /// Its tables and its name, as `udp.mode`.
    pub path: String,
    /// Its meaning.
    pub meaning: String,
    /// All that it may be, where that are a few words.
    pub choices: Vec<String>,
    /// Its value if nobody gives one, if it has any.
    pub default: Option<Json>,
    shape: Shape,
}

/// How a value stands in an environment variable or a flag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    /// As it is.
    Text,
    /// As in a file.
    Plain,
    /// Separated by commas.
    List,
}

impl OptionKey {
    /// Every key, by table and name.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let settings = SchemaSettings::default().with(|settings| settings.inline_subschemas = true);
        let schema = settings.into_generator().into_root_schema_for::<Options>();
        let mut found = Vec::new();
        Self::below("", schema.as_value(), &mut found);
        found.sort_by(|a, b| a.path.rsplit_once('.').cmp(&b.path.rsplit_once('.')));
        found
    }

    fn below(path: &str, schema: &Json, found: &mut Vec<Self>) {
        let Some(properties) = schema.get("properties").and_then(Json::as_object) else {
            let meaning = schema.get("description").and_then(Json::as_str).unwrap_or_default().to_owned();
            let choices = schema.get("oneOf").and_then(Json::as_array).into_iter().flatten();
            let choices =
                choices.filter_map(|choice| Some(choice.get("const")?.as_str()?.to_owned())).collect();
            let default = schema.get("default").filter(|default| !default.is_null());
            let shape = match schema.get("type").and_then(Json::as_str) {
                Some("array") => Shape::List,
                Some("boolean" | "integer" | "number") => Shape::Plain,
                None if schema.get("type").is_some() => Shape::Plain,
                _ => Shape::Text,
            };
            let (path, default) = (path.to_owned(), default.cloned());
            return found.push(Self { path, meaning, choices, default, shape });
        };
        for (name, property) in properties {
            let below = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            Self::below(&below, property, found);
        }
    }

    /// The tables of a configuration file that hold such keys.
    pub(super) fn tables() -> Vec<String> {
        let tables = Self::all().into_iter().filter_map(|key| Some(key.path.split_once('.')?.0.to_owned()));
        let mut tables: Vec<_> = tables.collect();
        tables.dedup();
        tables
    }

    /// The environment variable that gives it.
    #[must_use]
    pub fn variable(&self) -> String {
        format!("TRIMARAN_{}", self.path.replace('.', "_").to_uppercase())
    }

    /// The key with a value.
    fn given(&self, text: &str) -> Result<GivenOption, GivenOptionError> {
        let plain = |text: &str| text.parse().unwrap_or_else(|_| Value::String(text.to_owned()));
        let value = match self.shape {
            Shape::Text => Value::String(text.to_owned()),
            Shape::Plain => plain(text),
            Shape::List => Value::Array(text.split(',').map(plain).collect()),
        };
        let given = GivenOption { path: self.path.clone(), value };
        let mut alone = Table::new();
        given.put_into(&mut alone);
        Options::deserialize(alone).map_err(|cause| GivenOptionError::Value {
            key: self.path.clone(),
            why: cause.message().to_owned(),
        })?;
        Ok(given)
    }

    /// All keys as a configuration file has them, each commented out, with its meaning and its default.
    pub(super) fn template() -> String {
        let mut text = String::new();
        let mut table = String::new();
        for key in Self::all() {
            let (tables, name) = key.path.rsplit_once('.').unwrap_or_default();
            if tables != table {
                text += &format!("\n[{tables}]\n");
                tables.clone_into(&mut table);
            }
            for line in key.meaning.lines() {
                text += format!("\n# {line}").trim_end();
            }
            if !key.choices.is_empty() {
                text += &format!("\n# One of {}.", key.choices.join(", "));
            }
            text += &format!("\n#\n# Can also be specified via environment variable `{}`.\n", key.variable());
            text += &match &key.default {
                Some(default) => format!("#{name} = {default}\n"),
                None => format!("#{name} =\n"),
            };
        }
        text
    }
}

/// A key of the links' options with a value that it may have.
///
/// As text `udp.mode=deadline`.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenOption {
    path: String,
    value: Value,
}

/// A text that gives no option.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum GivenOptionError {
    /// There is no key.
    #[error("give KEY=VALUE, such as udp.mode=deadline")]
    Form,
    /// There is no such key.
    #[error("there is no key {0}: `trimaran config display` shows all")]
    Key(String),
    /// It cannot have this value.
    #[error("{key}: {why}")]
    Value {
        /// The key.
        key: String,
        /// The values that it may have.
        why: String,
    },
}

impl FromStr for GivenOption {
    type Err = GivenOptionError;

    fn from_str(text: &str) -> Result<Self, GivenOptionError> {
        let (path, value) = text.split_once('=').ok_or(GivenOptionError::Form)?;
        let key = OptionKey::all().into_iter().find(|key| key.path == path);
        key.ok_or_else(|| GivenOptionError::Key(path.to_owned()))?.given(value)
    }
}

impl GivenOption {
    fn put_into(&self, table: &mut Table) {
        let (tables, name) = self.path.rsplit_once('.').unwrap_or(("", &self.path));
        let mut within = table;
        for key in tables.split('.').filter(|key| !key.is_empty()) {
            let entry = within.entry(key).or_insert_with(|| Value::Table(Table::new()));
            let Value::Table(below) = entry else { return };
            within = below;
        }
        within.insert(name.to_owned(), self.value.clone());
    }
}

/// The options that `flags`, the environment, a `file`'s tables and the defaults make, the first of these
/// that has a key.
///
/// # Errors
/// When a variable of the environment has a bad value.
pub fn options(flags: &[GivenOption], file: Table) -> Result<Options, ConfigError> {
    let mut table = file;
    for key in OptionKey::all() {
        let variable = key.variable();
        let Some(text) = std::env::var_os(&variable).filter(|text| !text.is_empty()) else { continue };
        let given = key.given(&text.to_string_lossy());
        given.map_err(|cause| ConfigError::Variable { variable, cause })?.put_into(&mut table);
    }
    for given in flags {
        given.put_into(&mut table);
    }
    Options::deserialize(table).map_err(|cause| ConfigError::Options { cause: Box::new(cause) })
}
