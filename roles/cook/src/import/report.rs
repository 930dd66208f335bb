//! The report of an import, for people to judge it by.

use std::fmt;
use std::path::PathBuf;

/// Counts of an import, and its warnings.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// Files read.
    pub files: u64,
    /// Objects placed.
    pub objects: u64,
    /// Distinct meshes.
    pub meshes: u64,
    /// Triangles as drawn: each object counts its mesh's.
    pub triangles: u64,
    /// Triangles as stored: each mesh once.
    pub unique_triangles: u64,
    /// RVM primitives whose tessellation differs by more than 5 % from the box stored with them. A few are
    /// correct: writers store loose boxes for sheared snouts and eccentric pyramids.
    pub box_mismatches: u64,
    /// Parts (objects and the groups that they are in) of files that have attribute files.
    pub parts: u64,
    /// How many of `parts` an attribute file names.
    pub parts_matched: u64,
    /// Omissions and repairs: each kind once per file and detail, with its count.
    pub warnings: Vec<Warning>,
    /// Every file that the model depends on: those that were read, and missing ones that would have been. In
    /// order, each once.
    pub looked_for: Vec<PathBuf>,
}

/// An omission or repair of an import.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// Its kind.
    pub kind: WarningKind,
    /// The name of the model's file.
    pub file: String,
    /// A detail beyond the kind: a library, a material, an extension. Empty if there is none.
    pub detail: String,
    /// The first affected objects, at most [`Warning::OBJECTS`].
    pub objects: Vec<String>,
    /// How often it happened.
    pub count: u64,
}

/// A kind of omission or repair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum WarningKind {
    /// glTF primitives, OBJ elements, and PLY edges and faces of points or lines: they have no surface.
    PointsOrLines,
    /// glTF and OBJ materials, and PLY files, whose colour comes from a texture: drawn in their base colour.
    TexturedMaterial,
    /// OBJ material libraries that cannot be read: surfaces with their materials are drawn grey.
    MaterialsMissing,
    /// Uses of OBJ materials that no library defines: drawn grey.
    MaterialUndefined,
    /// Malformed lines of OBJ files and their libraries: a vertex without a place, or a colour that is not a
    /// number. Each costs only itself.
    MalformedLine,
    /// OBJ, STL and PLY faces with a corner at a vertex that does not exist or has no place: left out.
    FaceLeftOut,
    /// OBJ curves and surfaces that are not faces: left out.
    FreeForm,
    /// OBJ statements that are unknown, or that would read another file or run a program, and unknown words
    /// of STL: left out.
    UnknownStatement,
    /// glTF textures that cannot be read: their surfaces are drawn in the base colour.
    TextureUnread,
    /// glTF materials whose texture changes within a triangle: each triangle has the mean of the texture over
    /// it.
    TextureAveraged,
    /// glTF nodes with a skin: drawn as modelled, without it.
    SkinnedNode,
    /// glTF nodes that are hidden in the file: left out with all below them.
    HiddenNode,
    /// glTF nodes and instances with an invalid place: left out with all below them.
    NodeLeftOut,
    /// glTF triangles with a corner that is not finite or does not exist: left out.
    TriangleLeftOut,
    /// glTF metadata that does not apply to whole objects: left out.
    MetadataLeftOut,
    /// Faulty JSON in a glTF document with only one possible reading: read so.
    JsonMended,
    /// Values of a glTF document with the wrong type: left out.
    FieldLeftOut,
    /// Unreadable glTF buffers and compressed views: everything that needs them is left out.
    BytesLeftOut,
    /// glTF primitives that are broken: left out.
    PrimitiveLeftOut,
    /// glTF references to missing targets, or to nodes that have a place already: left out.
    ReferenceLeftOut,
    /// glTF nodes with a mesh outside of the scene that is read: left out.
    OutsideScene,
    /// Extensions that a glTF file requires and that change no shape: left out.
    ExtensionLeftOut,
    /// RVM insulation and obstruction volumes: they are reserved space, not things, and would hide their
    /// content.
    VolumeLeftOut,
    /// Objects whose matrix flattens them: their mesh was flattened instead.
    FlattenedObject,
    /// Objects without a single triangle: left out. In OBJ, STL and PLY a line or a point is no object.
    EmptyObject,
    /// RVM and glTF objects whose triangles are all lines or points, such as a cylinder of diameter 0: kept
    /// by their names, and not drawn.
    NoArea,
    /// Files of which no object is left, where others have objects.
    FileWithoutObject,
    /// Polygons with so many corners that exact cutting could take for ever: their holes are filled, and an
    /// equally large single contour is drawn without its notches.
    LargePolygon,
    /// RVM primitives that are broken: left out.
    BrokenPrimitive,
    /// Polygons of RVM primitives that are broken: left out.
    BrokenPolygon,
    /// RVM chunks of an unknown kind: skipped.
    UnknownChunk,
    /// RVM chunks of a known kind that cannot be read: left out.
    BrokenChunk,
    /// RVM groups with incomplete data: kept with that.
    BrokenGroup,
    /// Ends of RVM groups that never began: ignored.
    ExtraGroupEnd,
    /// RVM groups that never end: ended where their model ends.
    GroupLeftOpen,
    /// RVM models without their last chunk: read to their end.
    EndMissing,
    /// Bytes behind the last chunk of an RVM model that are no further model: ignored.
    BehindEnd,
    /// Bytes behind gzip data that are not gzip data: ignored.
    BehindPacked,
    /// Bytes behind the last triangle of an STL file, or behind the last row of a PLY file: ignored.
    BehindLast,
    /// Counts of triangles in binary STL that are placeholders: as many are read as the file holds.
    CountReplaced,
    /// Solids of an STL file that never end: ended where the file ends.
    SolidLeftOpen,
    /// Surfaces of STEP and IGES parts, and IFC elements, that the converter makes no triangles of: left out.
    SurfaceUnmeshed,
    /// IFC entities of no known class, or with a reference that leads nowhere: left out, or what refers so.
    EntityLeftOut,
    /// IFC spaces: left out, since they are full of air and would hide their content.
    SpaceLeftOut,
    /// IFC sets of properties that cannot be read: left out.
    PropertiesUnread,
    /// IFC map conversions that say no place: left out.
    MapUnread,
    /// IFC map conversions whose lengths are not true ones: nothing is scaled, so coordinates far from the
    /// origin differ by that.
    MapScaled,
    /// IFC files that say another place on the map than one before: not moved.
    ElsewhereOnMap,
    /// RVM groups with an unknown colour number: drawn grey.
    UnknownColour,
    /// RVM groups that are more than 100 % transparent: drawn opaque.
    SenselessTransparency,
    /// Unknown encodings of an RVM file: names are read as UTF-8, or else Latin-1.
    UnknownEncoding,
    /// Names in an RVM file that are not in its declared encoding: read as UTF-8, or else Latin-1.
    WrongEncoding,
    /// Attribute files beside an RVM file that cannot be read: left out.
    AttributesUnread,
    /// Lines of attribute files that are not an attribute of a group: left out.
    AttributeLineLeftOut,
    /// Attribute files that match no part of their RVM file: left out.
    AttributesUnmatched,
    /// Warnings beyond [`ImportReport::MOST_WARNINGS`] of a file: counted, not listed.
    Further,
}

impl ImportReport {
    /// How many different warnings of a file are listed. A file can have any number of names.
    pub const MOST_WARNINGS: usize = 1_000;

    /// How often each kind of warning came.
    #[must_use]
    pub fn counts(&self) -> Vec<(WarningKind, u64)> {
        let mut counts: Vec<(WarningKind, u64)> = Vec::new();
        for warning in &self.warnings {
            match counts.iter_mut().find(|(kind, _)| *kind == warning.kind) {
                Some((_, count)) => *count += warning.count,
                None => counts.push((warning.kind, warning.count)),
            }
        }
        counts
    }

    /// Notes that something happened `count` more times, without a name.
    pub(super) fn warn(&mut self, kind: WarningKind, count: u64) {
        self.note(kind, "", None, count);
    }

    /// Notes that something happened once to an object; `detail` names its cause, or is empty.
    pub(super) fn warn_of(&mut self, kind: WarningKind, detail: &str, object: &str) {
        self.note(kind, detail, Some(object), 1);
    }

    /// Notes that something happened `count` more times to an object; `detail` names its cause, or is empty.
    pub(super) fn warn_many(&mut self, kind: WarningKind, detail: &str, object: &str, count: u64) {
        self.note(kind, detail, Some(object), count);
    }

    /// Notes that something happened `count` more times; `detail` names its cause.
    pub(super) fn warn_about(&mut self, kind: WarningKind, detail: &str, count: u64) {
        self.note(kind, detail, None, count);
    }

    /// Notes that something happened `count` more times, with the first affected objects.
    pub(super) fn warn_first(&mut self, kind: WarningKind, detail: &str, objects: &[String], count: u64) {
        objects.iter().for_each(|object| self.note(kind, detail, Some(object), 1));
        self.note(kind, detail, None, count.saturating_sub(objects.len() as u64));
    }

    fn note(&mut self, kind: WarningKind, detail: &str, object: Option<&str>, count: u64) {
        if count == 0 {
            return;
        }
        let (mut kind, mut detail, mut object) = (kind, cut(detail), object.map(cut));
        let mut place = self.place(kind, detail);
        if place.is_none() && self.warnings.len() >= Self::MOST_WARNINGS {
            (kind, detail, object) = (WarningKind::Further, "", None);
            place = self.place(kind, detail);
        }
        let place = place.unwrap_or_else(|| {
            let (file, objects) = (String::new(), Vec::new());
            self.warnings.push(Warning { kind, file, detail: detail.to_owned(), objects, count: 0 });
            self.warnings.len() - 1
        });
        let Some(warning) = self.warnings.get_mut(place) else { return };
        warning.count += count;
        let object = object.filter(|_| warning.objects.len() < Warning::OBJECTS);
        warning.objects.extend(object.map(str::to_owned));
    }

    fn place(&self, kind: WarningKind, detail: &str) -> Option<usize> {
        self.warnings.iter().position(|warning| warning.kind == kind && warning.detail == detail)
    }

    /// Adds the report of one file, whose name is `file`; the model is counted as a whole.
    pub(super) fn absorb(&mut self, other: Self, file: &str) {
        self.box_mismatches += other.box_mismatches;
        self.parts += other.parts;
        self.parts_matched += other.parts_matched;
        let of_file = |warning| Warning { file: file.to_owned(), ..warning };
        self.warnings.extend(other.warnings.into_iter().map(of_file));
    }
}

impl Warning {
    /// How many objects are named.
    pub const OBJECTS: usize = 3;
}

/// The longest name in a warning, bytes.
const LONGEST_NAME: usize = 200;

/// A file's own name, cut to the length for a warning.
fn cut(name: &str) -> &str {
    name.get(..name.floor_char_boundary(LONGEST_NAME)).unwrap_or(name)
}

impl fmt::Display for Warning {
    /// One line: the file, the count, the kind, and the objects.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, file, detail, objects, count } = self;
        write!(f, "{file}: {count} {kind}")?;
        if !detail.is_empty() {
            write!(f, " ({detail})")?;
        }
        if let Some((first, rest)) = objects.split_first() {
            write!(f, "; first in {first:?}")?;
            rest.iter().try_for_each(|object| write!(f, ", {object:?}"))?;
        }
        Ok(())
    }
}

impl fmt::Display for WarningKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PointsOrLines => "primitives of points or lines left out: they have no surface",
            Self::TexturedMaterial => "textured materials drawn in their base colour",
            Self::MaterialsMissing => "material libraries that cannot be read: drawn grey",
            Self::MaterialUndefined => "uses of materials that no library defines: drawn grey",
            Self::MalformedLine => "malformed lines: what is wrong in them left out",
            Self::FaceLeftOut => "faces left out: a corner is at no vertex, or has no place",
            Self::FreeForm => "free-form curves and surfaces left out",
            Self::UnknownStatement => "statements left out: unknown or not supported",
            Self::TextureUnread => "textures that cannot be read: drawn in the base colour",
            Self::TextureAveraged => {
                "textured materials drawn in one colour a triangle, the texture's mean over it"
            }
            Self::SkinnedNode => "skinned nodes drawn as modelled",
            Self::HiddenNode => "hidden nodes left out with all below them",
            Self::NodeLeftOut => "nodes or instances left out with all below them: they have no place",
            Self::TriangleLeftOut => "triangles left out: a corner is not finite or does not exist",
            Self::MetadataLeftOut => {
                "metadata left out: attributes are kept where they are of a whole object"
            }
            Self::JsonMended => "places where the document is not JSON mended",
            Self::FieldLeftOut => "values that are not what the format demands left out",
            Self::BytesLeftOut => "buffers that cannot be read left out",
            Self::PrimitiveLeftOut => "broken primitives of meshes left out",
            Self::ReferenceLeftOut => "references that lead nowhere, or to a node with a place, left out",
            Self::OutsideScene => "nodes with a mesh left out: they are not in the scene that is read",
            Self::ExtensionLeftOut => "required extensions left out: they change no shape",
            Self::VolumeLeftOut => "insulation and obstruction volumes left out",
            Self::FlattenedObject => "objects that their matrix flattens",
            Self::EmptyObject => "objects without a triangle left out",
            Self::NoArea => "objects without an area kept by name: nothing of them can be drawn",
            Self::FileWithoutObject => "files without an object: nothing of them is in the scene",
            Self::LargePolygon => "polygons of more than 8,192 corners drawn without their holes",
            Self::BrokenPrimitive => "broken primitives left out",
            Self::BrokenPolygon => "broken polygons left out",
            Self::UnknownChunk => "chunks of an unknown kind skipped",
            Self::BrokenChunk => "broken chunks left out",
            Self::BrokenGroup => "broken groups kept with what can be read of them",
            Self::ExtraGroupEnd => "ends of groups that never began ignored",
            Self::GroupLeftOpen => "groups that never end, ended with their model",
            Self::EndMissing => "models without their last chunk, END:, read to where they stop",
            Self::BehindEnd => "stretches of bytes behind END: that are no model ignored",
            Self::BehindPacked => "stretches of bytes behind what gzip packed ignored",
            Self::BehindLast => "stretches of bytes behind the last triangle or row ignored",
            Self::CountReplaced => {
                "counts of triangles that are placeholders replaced by what the file holds"
            }
            Self::SolidLeftOpen => "solids that never end, ended with their file",
            Self::SurfaceUnmeshed => "surfaces left out: no triangles can be made of them",
            Self::EntityLeftOut => "entities of no known class, or references to none, left out",
            Self::SpaceLeftOut => "spaces left out: they would hide what is in them",
            Self::PropertiesUnread => "sets of properties that cannot be read left out",
            Self::MapUnread => "map conversions that say no place left out",
            Self::MapScaled => "map conversions that stretch lengths: nothing is stretched",
            Self::ElsewhereOnMap => "files that say another place on the map than one before: not moved",
            Self::UnknownColour => "groups without a known colour drawn grey",
            Self::SenselessTransparency => "groups more than 100 % transparent drawn opaque",
            Self::UnknownEncoding => "unknown encodings of names, read as UTF-8 or Latin-1",
            Self::WrongEncoding => {
                "names that are not in the encoding of their file, read as UTF-8 or Latin-1"
            }
            Self::AttributesUnread => "attribute files that cannot be read left out",
            Self::AttributeLineLeftOut => "lines of attribute files left out: they say no attribute",
            Self::AttributesUnmatched => "attribute files that name no part of the model left out",
            Self::Further => "further warnings, not listed",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_add_up() {
        let mut all = ImportReport::default();
        let mut one = ImportReport { box_mismatches: 3, ..Default::default() };
        one.warn(WarningKind::EmptyObject, 4);
        one.warn(WarningKind::SkinnedNode, 0);
        all.absorb(one.clone(), "a.rvm");
        all.absorb(one, "b.rvm");
        assert_eq!(all.box_mismatches, 6);
        assert_eq!(all.counts(), [(WarningKind::EmptyObject, 8)]);
        let files: Vec<&str> = all.warnings.iter().map(|warning| &*warning.file).collect();
        assert_eq!(files, ["a.rvm", "b.rvm"]);
    }

    #[test]
    fn a_warning_names_its_file_what_it_is_about_and_the_first_objects() {
        let mut report = ImportReport::default();
        for object in ["pump", "tank", "pipe", "valve"] {
            report.warn_of(WarningKind::MaterialsMissing, "steel.mtl", object);
        }
        let mut all = ImportReport::default();
        all.absorb(report, "a.obj");
        let said = all.warnings[0].to_string();
        assert_eq!(
            said,
            "a.obj: 4 material libraries that cannot be read: drawn grey (steel.mtl); \
             first in \"pump\", \"tank\", \"pipe\""
        );
    }

    #[test]
    fn however_many_names_a_file_makes_up_the_list_has_an_end() {
        let mut report = ImportReport::default();
        for number in 0..ImportReport::MOST_WARNINGS + 5 {
            report.warn_about(WarningKind::MaterialsMissing, &format!("{number} {}", "ä".repeat(500)), 1);
        }
        assert_eq!(report.warnings.len(), ImportReport::MOST_WARNINGS + 1);
        assert_eq!(report.counts()[1], (WarningKind::Further, 5));
        assert!(report.warnings.iter().all(|warning| warning.detail.len() <= LONGEST_NAME));
    }
}
