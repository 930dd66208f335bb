//! The cooked scene, shared by all roles, in memory or in a file, loaded on demand.

mod coordinates;
mod encode;
mod entries;
mod faults;
mod file;
mod flat;
mod geometry;
mod given;
mod hierarchy;
mod hierarchy_bytes;
mod layout;
mod levels;
mod open_error;
mod overview;
mod read_error;
mod records;
mod shading;
mod source;
mod table;
mod validate;

use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use glam::Vec3;
use rayon::prelude::*;
use trimaran_proto::{DrawableId, ObjectSet, SceneHash};

pub use coordinates::{Coordinates, FileFrame, PlantFrame, UpAxis};
pub use entries::{EntriesError, MOST_ENTRIES, pack_entries, unpack_entries};
use faults::Faults;
pub use file::SaveError;
use file::SceneFile;
pub use flat::FlatObject;
pub use geometry::{Geometry, GeometryError, GeometryPlace};
use given::Given;
pub use given::{DrawableEntry, GiveError};
pub use hierarchy::{Attribute, Extent, Group, Hierarchy, ObjectAttributes};
use layout::{Firsts, Section};
pub use layout::{Totals, VERSION as FORMAT_VERSION, VERSIONS as FORMAT_VERSIONS};
pub use levels::{GroupLevel, GroupLevelError};
pub use open_error::OpenError;
pub use overview::{Bounds, Overview};
pub use read_error::{ReadCause, ReadError};
pub use records::{Drawable, Level, Node, NodeId, ObjectRecord, Rgba8, SceneArrays, Sides, Vertex};
pub use shading::{Normal, Shading};
use source::Source;
use table::Pages;
pub use table::Records;
pub use validate::SceneError;

/// Whether a file that begins with `head` is a cooked scene, of any version and in any state.
#[must_use]
pub fn looks_like_a_scene(head: &[u8]) -> bool {
    head.starts_with(&layout::MAGIC)
}

/// A cooked scene, with the requested parts in memory.
///
/// Records are read from its file a page at a time, on first use, and stay. Geometry is read each time. Each
/// page is checked when it is read: its bytes against the fingerprint, and its records against the rules, so
/// that later code can trust them: every index is in range, every box finite, errors never fall towards the
/// root.
///
/// A traversal leaves out parts that cannot be read. Run it within [`reading`](Self::reading), which returns
/// the error.
#[derive(Debug)]
pub struct Scene {
    file: Arc<SceneFile>,
    nodes: Pages<Node>,
    drawables: Pages<Drawable>,
    places: Pages<GeometryPlace>,
    objects: Pages<ObjectRecord>,
    names: OnceLock<String>,
    sources: Vec<String>,
    see_through: ObjectSet,
    faults: Faults,
    /// The given parts, if there is no file.
    given: Option<Box<Given>>,
}

/// The levels of a node, finest first.
#[derive(Debug, Clone)]
pub struct Levels<'s> {
    drawables: Records<'s, Drawable>,
    left: Range<u32>,
}

/// Reads geometry, and caches the last page: pieces with near numbers share pages.
#[derive(Debug)]
pub struct GeometryReader<'s> {
    scene: &'s Scene,
    page: Option<(u32, Vec<u8>)>,
}

impl Scene {
    /// Checks the arrays and makes a scene of them, in the file's form. Computes each node's
    /// [`reach`](Node::reach).
    ///
    /// # Errors
    /// The first malformed record.
    pub fn from_arrays(arrays: SceneArrays) -> Result<Self, SceneError> {
        let whole = (0..).zip(&arrays.objects).find(|(_, object)| arrays.name_of(object).is_none());
        if let Some((index, _)) = whole {
            return Err(SceneError::Malformed { what: "object", index, why: NO_NAME });
        }
        let bytes = encode::encode(arrays)?;
        let source = Source::Memory(bytes);
        // Freshly encoded bytes can be opened, unless their records break a rule.
        let unread = |_| SceneError::Malformed { what: "file", index: 0, why: "it cannot be read back" };
        let file = SceneFile::read(source, Path::new("in memory")).map_err(unread)?;
        let scene = Self::unread(Arc::new(file)).map_err(rule)?;
        if scene.check_records().is_ok() {
            return Ok(scene);
        }
        // Pages were checked in any order. Again in order, for the first record that breaks a rule.
        let scene = Self::unread(scene.file).map_err(rule)?;
        let _ = (scene.nodes().iter().count(), scene.places().iter().count());
        let _ = (scene.drawables().iter().count(), scene.objects().iter().count());
        scene.check_records().map_err(rule)?;
        Ok(scene)
    }

    /// Opens a scene that [`Scene::save`] wrote: reads and checks its header, its directory and the top of
    /// its tree. All else is checked on first use.
    ///
    /// **An open scene never changes.** A file that is replaced or deleted stays readable. One that is
    /// overwritten in place no longer matches its fingerprint: loaded parts stay, and others cannot
    /// be read.
    ///
    /// # Errors
    /// The error in the file, and the remedy. [`OpenError::may_pass`] tells a file that is not there yet or
    /// is being written from one that stays unusable.
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        Self::of(Arc::new(SceneFile::open(path)?)).map_err(OpenError::Read)
    }

    /// Opens a scene whose file is in memory. `name` names it in errors.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn open_bytes(name: &Path, bytes: &[u8]) -> Result<Self, OpenError> {
        let file = SceneFile::read(Source::Memory(bytes.to_vec()), name)?;
        Self::of(Arc::new(file)).map_err(OpenError::Read)
    }

    /// The same scene with nothing of it in memory yet, for passing through much of it once.
    ///
    /// # Errors
    /// If the top of its tree cannot be read any more.
    pub fn opened_again(&self) -> Result<Self, ReadError> {
        Self::of(Arc::clone(&self.file))
    }

    fn of(file: Arc<SceneFile>) -> Result<Self, ReadError> {
        let scene = Self::unread(file)?;
        // The top of the tree.
        let _ = (scene.nodes().first(), scene.drawables().first());
        match scene.faults.first() {
            Some(fault) => Err(fault.clone()),
            None => Ok(scene),
        }
    }

    /// A scene with no records loaded.
    fn unread(file: Arc<SceneFile>) -> Result<Self, ReadError> {
        let header = file.header();
        let of_all = 0..header.objects as usize;
        let damaged = || file.error(Section::Sources, 0, &of_all, ReadCause::Damaged);
        let bytes = file.unpack(Section::Sources, 0, &of_all)?;
        let (sources, see_through) = encode::decode_sources(&bytes, header.objects).ok_or_else(damaged)?;
        Ok(Self { sources, see_through, ..Self::of_nothing(file, None) })
    }

    /// A scene with no records loaded, or without pages and with only the `given` parts.
    fn of_nothing(file: Arc<SceneFile>, given: Option<Given>) -> Self {
        let (header, paged) = (file.header(), given.is_none());
        Self {
            nodes: validate::node_pages(header.nodes as usize, paged),
            drawables: validate::drawable_pages(header.drawables as usize, paged),
            places: validate::place_pages(header.geometries as usize, paged),
            objects: validate::object_pages(header.objects as usize, paged),
            names: OnceLock::new(),
            sources: Vec::new(),
            see_through: ObjectSet::default(),
            faults: Faults::none(),
            file,
            given: given.map(Box::new),
        }
    }

    /// Writes the scene to `path`: to a temporary name in the same folder, flushed to the disk and then
    /// renamed, so that a reader sees the old file or the whole new one. The same scene always makes the
    /// same bytes.
    ///
    /// # Errors
    /// If the system refuses, or the scene's own file is damaged; nothing is left behind then.
    pub fn save(&self, path: &Path) -> Result<(), SaveError> {
        self.file.save(path)
    }

    /// The nodes, breadth first; the root is the first.
    #[must_use]
    pub const fn nodes(&self) -> Records<'_, Node> {
        Records::new(self, &self.nodes)
    }

    /// How many leaves the tree has.
    #[must_use]
    pub fn leaf_count(&self) -> u32 {
        self.file.header().leaves
    }

    /// A leaf by its number among all leaves, in the order of the nodes: reads one page of nodes at most.
    #[must_use]
    pub fn leaf(&self, number: u32) -> Option<(NodeId, &Node)> {
        let nodes = self.nodes();
        let page = self.file.page_of_leaf(number);
        let [Firsts { leaf: first, .. }, _] = self.file.firsts(page);
        let numbered = nodes.numbers(page).filter_map(|id| Some((NodeId(id as u32), nodes.get(id)?)));
        numbered.filter(|(_, node)| node.is_leaf()).nth(number.checked_sub(first)? as usize)
    }

    /// The levels of a node, finest first.
    #[must_use]
    pub fn levels(&self, node: &Node) -> Levels<'_> {
        let left = node.first_drawable..node.first_drawable.saturating_add(node.drawable_count);
        Levels { drawables: self.drawables(), left }
    }

    /// A drawable, and its node with the boxes of the drawable. `None` past the last one, if it cannot be
    /// read, and if it was not given.
    #[must_use]
    pub fn part(&self, id: DrawableId) -> Option<(&Drawable, Node)> {
        let drawable = self.drawables().get(id.index())?;
        let node = self.nodes().get(drawable.node as usize)?;
        let part = match self.given() {
            Some(given) => given.part(id, node)?,
            None if drawable.pieces == 1 => *node,
            None => {
                let (min, max) = self.places().get(drawable.geometry as usize)?.local_box();
                node.part(min, max)
            }
        };
        Some((drawable, part))
    }

    /// The drawables; a [`DrawableId`](trimaran_proto::DrawableId) is the number of one.
    #[must_use]
    pub const fn drawables(&self) -> Records<'_, Drawable> {
        Records::new(self, &self.drawables)
    }

    /// The place and size of each piece of geometry, by the numbers of [`Drawable::geometry`].
    #[must_use]
    pub const fn places(&self) -> Records<'_, GeometryPlace> {
        Records::new(self, &self.places)
    }

    /// The objects, for names in reports.
    #[must_use]
    pub const fn objects(&self) -> Records<'_, ObjectRecord> {
        Records::new(self, &self.objects)
    }

    /// A piece of geometry, to read one; for many make one [`reader`](Self::reader).
    ///
    /// # Errors
    /// If it does not exist, or cannot be read.
    pub fn geometry(&self, number: u32) -> Result<Geometry, ReadError> {
        self.reader().read(number)
    }

    /// Reads geometry.
    #[must_use]
    pub const fn reader(&self) -> GeometryReader<'_> {
        GeometryReader { scene: self, page: None }
    }

    /// The name of an object (index into [`Scene::objects`]); `None` past their end, empty if the object has
    /// no name. `None` as well if it cannot be read, which [`reading`](Self::reading) tells.
    #[must_use]
    pub fn object_name(&self, object: u32) -> Option<&str> {
        let record = self.objects().get(object as usize)?;
        let names = match self.names.get() {
            Some(names) => names,
            None => self.read_names()?,
        };
        let name = record.name_in(names);
        if name.is_none() {
            let error = SceneError::Malformed { what: "object", index: object as usize, why: NO_NAME };
            self.set_fault(self.file.malformed(Section::Names, 0, &(0..0), error));
        }
        name
    }

    /// The name of a source file ([`ObjectRecord::source`]); `None` past their end.
    #[must_use]
    pub fn source_name(&self, source: u32) -> Option<&str> {
        self.sources.get(source as usize).map(String::as_str)
    }

    /// The names of the files the objects came from.
    #[must_use]
    pub fn sources(&self) -> &[String] {
        &self.sources
    }

    /// The objects that the model has see-through, with which a view begins. Empty if the scene comes over a
    /// link: [`is_see_through`](Self::is_see_through) covers the received parts.
    #[must_use]
    pub const fn see_through(&self) -> &ObjectSet {
        &self.see_through
    }

    /// Whether any present part of the model is see-through.
    #[must_use]
    pub fn has_see_through(&self) -> bool {
        !self.see_through.is_empty() || self.given().is_some_and(Given::has_see_through)
    }

    /// Whether the model has `object` see-through, which `node` is, is a part of, or contains.
    #[must_use]
    pub fn is_see_through(&self, node: NodeId, object: u32) -> bool {
        match self.given() {
            Some(given) => given.is_see_through(node.0),
            None => self.see_through.contains(object),
        }
    }

    /// The grouping of the objects in their files, and their attributes. It is read anew each time.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn hierarchy(&self) -> Result<Hierarchy, ReadError> {
        let all = 0..self.objects().len();
        let bytes = self.file.unpack(Section::Hierarchy, 0, &all)?;
        let damaged = || self.file.error(Section::Hierarchy, 0, &all, ReadCause::Damaged);
        let hierarchy = hierarchy_bytes::decode(&bytes).ok_or_else(damaged)?;
        let malformed = |error| self.file.malformed(Section::Hierarchy, 0, &all, error);
        hierarchy.check(all.end as u32).map_err(malformed)?;
        Ok(hierarchy)
    }

    /// The coordinates that people know: of the plant, and of the source files. A scene that says nothing of
    /// them has those of glTF: x is east, -z north and y up. It is read anew each time.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn coordinates(&self) -> Result<Coordinates, ReadError> {
        self.file.coordinates(self.sources.len())
    }

    /// A drawable's triangles, in its node's local frame. None if they cannot be read, which
    /// [`reading`](Self::reading) tells.
    pub fn triangles(&self, drawable: &Drawable) -> impl Iterator<Item = [Vec3; 3]> + use<> {
        let geometry = self.geometry(drawable.geometry).unwrap_or_else(|fault| {
            self.set_fault(fault);
            Geometry::default()
        });
        let triangles = 0..geometry.triangles();
        triangles.filter_map(move |triangle| {
            let corner = |corner: usize| {
                let index = *geometry.indices.get(3 * triangle + corner)?;
                Some(Vec3::from_array(geometry.vertices.get(index as usize)?.position))
            };
            Some([corner(0)?, corner(1)?, corner(2)?])
        })
    }

    /// A node and all its ancestors, up to the root.
    pub fn ancestors(&self, node: NodeId) -> impl Iterator<Item = (NodeId, &Node)> {
        let get = |id: u32| self.nodes().get(id as usize).map(|node| (NodeId(id), node));
        std::iter::successors(get(node.0), move |(_, node)| get(node.parent))
    }

    /// Sums over the whole scene.
    #[must_use]
    pub fn totals(&self) -> Totals {
        self.file.header().totals
    }

    /// The fingerprint that peers compare: the root of the tree of hashes over the file.
    #[must_use]
    pub fn hash(&self) -> SceneHash {
        self.file.header().scene_hash()
    }

    /// The first unreadable part that any thread has requested, for reports.
    #[must_use]
    pub fn fault(&self) -> Option<&ReadError> {
        self.faults.first()
    }

    /// The result of `work`, for which no part of the scene was left out as unreadable.
    ///
    /// # Errors
    /// The last unreadable part that `work` requests on this thread.
    pub fn reading<T>(&self, work: impl FnOnce() -> T) -> Result<T, ReadError> {
        self.faults.within(work)
    }

    /// Bytes of records in memory, and of given geometry.
    #[must_use]
    pub fn resident_bytes(&self) -> u64 {
        let bytes = self.given().map_or(0, Given::bytes)
            + self.nodes.resident() * size_of::<Node>()
            + self.drawables.resident() * size_of::<Drawable>()
            + self.places.resident() * size_of::<GeometryPlace>()
            + self.objects.resident() * size_of::<ObjectRecord>();
        bytes as u64
    }

    /// Reads and checks all of the file. Its records stay in memory.
    ///
    /// # Errors
    /// The first fault, if there is one.
    pub fn check(&self) -> Result<(), ReadError> {
        self.check_records()?;
        let count = self.places().len() as u32;
        let runs: Vec<u32> = (0..count).step_by(1 << 10).collect();
        runs.par_iter().try_for_each(|&first| {
            let mut reader = self.reader();
            (first..count.min(first + (1 << 10))).try_for_each(|number| reader.read(number).map(drop))
        })?;
        if self.totals() == self.summed() {
            return Ok(());
        }
        let why = "its sums are not those of its records";
        let error = SceneError::Malformed { what: "header", index: 0, why };
        Err(self.file.malformed(Section::Nodes, 0, &(0..self.nodes().len()), error))
    }

    /// The correct [`totals`](Self::totals).
    fn summed(&self) -> Totals {
        let leaves = self.nodes().iter().filter(|node| node.is_leaf());
        let finest = leaves.filter_map(|leaf| self.levels(leaf).next()).flat_map(Level::pieces);
        let finest = finest.filter_map(|id| self.drawables().get(id.index()));
        let places = self.places().iter();
        Totals {
            full_detail_triangles: finest.map(|drawable| u64::from(drawable.triangles)).sum(),
            stored_triangles: places.clone().map(|place| u64::from(place.triangles)).sum(),
            stored_vertices: places.map(|place| u64::from(place.vertices)).sum(),
        }
    }

    /// Reads and checks all records and names.
    fn check_records(&self) -> Result<(), ReadError> {
        // Nodes first, as drawables are checked against them.
        self.nodes().load_all();
        self.places().load_all();
        self.drawables().load_all();
        self.objects().load_all();
        let _ = (0..self.objects().len() as u32).all(|object| self.object_name(object).is_some());
        match self.fault() {
            Some(fault) => Err(fault.clone()),
            None => self.hierarchy().and(self.coordinates()).and(self.stored_overview()).map(drop),
        }
    }

    /// A piece of geometry as stored in the file: see [`Geometry::unpack`].
    ///
    /// # Errors
    /// If it does not exist, or cannot be read.
    pub fn packed_geometry(&self, number: u32) -> Result<Vec<u8>, ReadError> {
        self.reader().packed(number, <[u8]>::to_vec)
    }

    /// The overview in the file, if there is one.
    pub(crate) fn stored_overview(&self) -> Result<Option<Overview>, ReadError> {
        self.file.overview()
    }

    /// Adds it to the file of a scene that is in memory, not shared yet, and has none.
    pub(crate) fn add_overview(&mut self, overview: &Overview) {
        if let Some(file) = Arc::get_mut(&mut self.file) {
            file.add_overview(overview);
        }
    }

    fn given(&self) -> Option<&Given> {
        self.given.as_deref()
    }

    fn file(&self) -> &SceneFile {
        &self.file
    }

    fn read_names(&self) -> Option<&str> {
        let names = self.file.unpack(Section::Names, 0, &(0..0)).and_then(|bytes| {
            let damaged = |_| self.file.error(Section::Names, 0, &(0..0), ReadCause::Damaged);
            String::from_utf8(bytes).map_err(damaged)
        });
        match names {
            Ok(names) => Some(self.names.get_or_init(|| names)),
            Err(fault) => {
                self.set_fault(fault);
                None
            }
        }
    }

    fn set_fault(&self, fault: ReadError) {
        self.faults.note(fault);
    }
}

impl Iterator for Levels<'_> {
    type Item = Level;

    fn next(&mut self) -> Option<Level> {
        let id = DrawableId(self.left.start);
        let level = self.drawables.get(id.index()).filter(|_| !self.left.is_empty())?.level(id);
        self.left.start = self.left.start.saturating_add(level.pieces().len() as u32);
        Some(level)
    }
}

impl DoubleEndedIterator for Levels<'_> {
    fn next_back(&mut self) -> Option<Level> {
        let id = DrawableId(self.left.end.checked_sub(1)?);
        let level = self.drawables.get(id.index()).filter(|_| !self.left.is_empty())?.level(id);
        self.left.end = level.first().0;
        Some(level)
    }
}

impl GeometryReader<'_> {
    /// A piece of geometry.
    ///
    /// # Errors
    /// If it does not exist, or cannot be read.
    pub fn read(&mut self, number: u32) -> Result<Geometry, ReadError> {
        let (geometry, length) = self.packed(number, |bytes| (Geometry::unpack(bytes), bytes.len()))?;
        let place = self.scene.places().get(number as usize);
        let geometry = geometry.map_err(|cause| self.error(number, cause.into()))?;
        match place {
            Some(place) if place.fits(&geometry) => Ok(geometry),
            _ => Err(self.error(number, GeometryError::Length(length).into())),
        }
    }

    /// Applies `take` to a piece as stored in the file.
    fn packed<T>(&mut self, number: u32, take: impl FnOnce(&[u8]) -> T) -> Result<T, ReadError> {
        let scene = self.scene;
        let missing = || self.error(number, GeometryError::Length(0).into());
        if let Some(given) = &scene.given {
            return given.geometry(number).map(|bytes| take(&bytes)).ok_or_else(missing);
        }
        let place = scene.places().read(number as usize)?.ok_or_else(missing)?;
        Ok(take(scene.file.geometry(number as usize, place, &mut self.page)?))
    }

    fn error(&self, number: u32, cause: ReadCause) -> ReadError {
        let page = self.scene.places().get(number as usize).map_or(0, |place| place.page as usize);
        let index = number as usize;
        self.scene.file.error(Section::Geometry, page, &(index..index + 1), cause)
    }
}

impl SceneArrays {
    fn name_of(&self, object: &ObjectRecord) -> Option<&str> {
        object.name_in(&self.names)
    }
}

impl ObjectRecord {
    fn name_in<'n>(&self, names: &'n str) -> Option<&'n str> {
        let start = self.name_start as usize;
        names.get(start..start.checked_add(self.name_length as usize)?)
    }
}

/// The error of an object with an invalid name.
const NO_NAME: &str = "its name is not a range of whole characters of the names";

/// The broken rule of the format.
fn rule(error: ReadError) -> SceneError {
    match error.cause {
        ReadCause::Malformed(error) => error,
        _ => SceneError::Malformed { what: "file", index: 0, why: "it cannot be read back" },
    }
}

#[cfg(test)]
mod tests;
