//! Tables of properties (EXT_structural_metadata). A row describes a feature: some triangles of a mesh
//! (EXT_mesh_features), or an instance (EXT_instance_features).

use std::collections::{BTreeMap, BTreeSet};

use serde::de::IgnoredAny;
use serde_json::Value;
use trimaran_scene::Attribute;

use super::accessor::Accessors;
use super::column::Column;
use super::json::{Document, Node};
use super::nodes::Placement;
use super::objects::objects;
use crate::import::report::{ImportReport, WarningKind};

/// A feature: a row of a property table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Feature {
    pub table: u32,
    pub row: u32,
}

objects! {
    pub(super) struct Metadata {
        schema: Schema,
        property_tables: Vec<Table>,
        property_textures: Vec<IgnoredAny>,
        property_attributes: Vec<IgnoredAny>,
    }

    struct Schema {
        classes: BTreeMap<String, Class>,
        enums: BTreeMap<String, Enumeration>,
    }

    struct Class {
        properties: BTreeMap<String, Property>,
    }

    /// The type of a property's values.
    pub(super) struct Property {
        name: Option<String>,
        semantic: Option<String>,
        pub kind: String = "type",
        pub component_type: Option<String>,
        pub enum_type: Option<String>,
        pub array: bool,
        /// Of an array, unless each has its own.
        pub count: Option<u64>,
        pub normalized: bool,
        pub offset: Option<Value>,
        pub scale: Option<Value>,
        /// The value that means none.
        no_data: Option<Value>,
        default: Option<Value>,
    }

    pub(super) struct Enumeration {
        pub value_type: Option<String>,
        pub values: Vec<EnumerationValue>,
    }

    pub(super) struct EnumerationValue {
        pub name: String,
        pub value: Option<i64>,
    }

    pub(super) struct Table {
        class: String,
        count: u64,
        properties: BTreeMap<String, Column>,
    }

    /// The features of a primitive or of a node's instances, in several numberings.
    pub(super) struct Features {
        feature_ids: Vec<FeatureIds>,
    }

    /// A numbering of features: by an attribute, or by vertex or instance number. Those of textures are not
    /// read.
    pub(super) struct FeatureIds {
        pub attribute: Option<u32>,
        texture: Option<IgnoredAny>,
        property_table: Option<u32>,
        null_feature_id: Option<u32>,
    }
}

impl Features {
    /// The first numbering that has a table.
    pub(super) fn with_table(&self) -> Option<&FeatureIds> {
        self.feature_ids.iter().find(|ids| ids.property_table.is_some() && ids.texture.is_none())
    }
}

impl FeatureIds {
    /// The feature with a number.
    pub(super) fn feature(&self, number: f32) -> Option<Feature> {
        self.row(number.round() as u32)
    }

    fn row(&self, row: u32) -> Option<Feature> {
        let table = self.property_table.filter(|_| Some(row) != self.null_feature_id)?;
        Some(Feature { table, row })
    }
}

/// The attributes of a feature.
#[derive(Debug, Default)]
pub(super) struct Row {
    pub name: Option<String>,
    pub attributes: Vec<Attribute>,
    /// Properties that cannot be read.
    pub unread: Vec<String>,
}

impl Row {
    /// Bytes of all texts.
    pub(super) fn text(&self) -> u64 {
        let attributes = self.attributes.iter().map(|one| one.name.len() + one.value.len());
        (attributes.sum::<usize>() + self.name.as_ref().map_or(0, String::len)) as u64
    }
}

impl Metadata {
    pub(super) fn of(document: &Document) -> Option<&Self> {
        document.extensions.as_ref()?.metadata.as_ref()
    }

    /// The row of a feature.
    pub(super) fn row(&self, accessors: &Accessors<'_>, feature: Feature) -> Row {
        let mut row = Row::default();
        let Some(table) = self.property_tables.get(feature.table as usize) else {
            row.unread.push(format!("property table {}: it does not exist", feature.table));
            return row;
        };
        let class = self.schema.classes.get(&table.class);
        if class.is_none() {
            row.unread.push(format!("class {}: it is not in the schema", table.class));
        }
        for (id, property) in class.into_iter().flat_map(|class| &class.properties) {
            let column = table.properties.get(id).filter(|_| u64::from(feature.row) < table.count);
            let value = match column.map(|column| {
                let names = property.enum_type.as_ref().and_then(|name| self.schema.enums.get(name));
                column.value(accessors, property, names, feature.row.into())
            }) {
                None => property.default.clone(),
                Some(Ok(value)) if Some(&value) == property.no_data.as_ref() => property.default.clone(),
                Some(Ok(value)) => Some(value),
                Some(Err(why)) => {
                    row.unread.push(format!("property {id}: {why}"));
                    None
                }
            };
            let Some(value) = value else { continue };
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            if property.semantic.as_deref() == Some("NAME") || id.eq_ignore_ascii_case("name") {
                row.name = Some(value.clone());
            }
            let name = property.name.as_ref().unwrap_or(id).clone();
            row.attributes.push(Attribute { name: name.into(), value: value.into() });
        }
        row
    }
}

/// Looks features up, and keeps unreadable ones.
pub(super) struct Lookup<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
    metadata: Option<&'a Metadata>,
    told: BTreeSet<u32>,
    unread: BTreeSet<String>,
    /// The node of the last instance look-up, and its features.
    instances: Option<(u32, Vec<Option<Feature>>)>,
}

impl<'a> Lookup<'a> {
    pub(super) fn new(document: &'a Document, accessors: &'a Accessors<'a>) -> Self {
        let metadata = Metadata::of(document);
        Self {
            document,
            accessors,
            metadata,
            told: BTreeSet::new(),
            unread: BTreeSet::new(),
            instances: None,
        }
    }

    /// The attributes of a placement's feature piece, or of an instance that is a feature.
    pub(super) fn row(&mut self, placement: &Placement, piece: Option<Feature>) -> Option<Row> {
        let metadata = self.metadata?;
        let feature = piece.or_else(|| self.of_instance(placement))?;
        let row = metadata.row(self.accessors, feature);
        self.told.insert(feature.table);
        // As many as a report may list.
        if self.unread.len() < ImportReport::MOST_WARNINGS {
            self.unread.extend(row.unread.iter().cloned());
        }
        Some(row)
    }

    fn of_instance(&mut self, placement: &Placement) -> Option<Feature> {
        let node = self.document.nodes.get(placement.node as usize)?;
        if self.instances.as_ref().is_none_or(|(known, _)| *known != placement.node) {
            self.instances = Some((placement.node, self.of_instances(node).unwrap_or_default()));
        }
        let (_, features) = self.instances.as_ref()?;
        match features.get(placement.instance as usize) {
            Some(feature) => *feature,
            None => {
                let ids = node.extensions.as_ref()?.features.as_ref()?.with_table()?;
                ids.attribute.is_none().then(|| ids.row(placement.instance)).flatten()
            }
        }
    }

    /// The features of a node's instances, if an attribute numbers them.
    fn of_instances(&self, node: &Node) -> Option<Vec<Option<Feature>>> {
        let ids = node.extensions.as_ref()?.features.as_ref()?.with_table()?;
        let name = format!("_FEATURE_ID_{}", ids.attribute?);
        let numbers = self.accessors.vectors::<1>(*node.instancing()?.attributes.get(&name)?).ok()?;
        Some(numbers.into_iter().map(|[number]| ids.feature(number)).collect())
    }

    /// Warns of properties that apply to no object.
    pub(super) fn warn(self, report: &mut ImportReport) {
        let Some(metadata) = self.metadata else { return };
        for why in self.unread {
            report.warn_about(WarningKind::MetadataLeftOut, &why, 1);
        }
        for (number, table) in (0..).zip(&metadata.property_tables) {
            if !self.told.contains(&number) {
                let detail = format!("property table {number} of {:?}: no object refers to it", table.class);
                report.warn_about(WarningKind::MetadataLeftOut, &detail, 1);
            }
        }
        let textures = metadata.property_textures.len() as u64;
        report.warn_about(WarningKind::MetadataLeftOut, "property textures", textures);
        let of_vertices = metadata.property_attributes.len() as u64;
        report.warn_about(WarningKind::MetadataLeftOut, "property attributes", of_vertices);
    }
}
