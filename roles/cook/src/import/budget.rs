//! The limits of an import. A file's requests are counted before memory is allocated for them.

use std::collections::BTreeSet;
use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use thiserror::Error;

/// The limits of an import over all its files together.
///
/// A small file can ask for a great deal: a thousand meshes may share one array of positions, and a thousand
/// nodes one list of instances. Memory while importing stays below [`ImportLimits::memory`] of the size of the
/// files, including those that they refer to, and unpacked sizes of packed ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImportLimits {
    /// Triangles as stored: each mesh once. At most [`ImportLimits::MOST_TRIANGLES`] counts.
    pub triangles: u64,
    /// Vertices as stored, before equal ones are joined; four texels of a texture count as one, and so do 32
    /// bytes that are decompressed. At most [`ImportLimits::MOST_RECORDS`] counts.
    pub vertices: u64,
    /// Objects; instances count each. One with a long name counts as several: one more for each
    /// [`NAME_UNIT`] bytes. At most [`ImportLimits::MOST_RECORDS`] counts.
    pub objects: u64,
    /// How deep nodes or groups may be nested.
    pub depth: u32,
    /// Bytes of attributes: those in the files, and again for each further object or group with the same
    /// ones.
    pub attribute_bytes: u64,
}

/// The memory for an object's name without counting as another object, bytes.
pub const NAME_UNIT: u64 = 256;

/// How many texels of a texture take the memory of a vertex.
const TEXELS_A_VERTEX: u64 = 4;

impl ImportLimits {
    /// The limit of numbering triangles by their corners.
    pub const MOST_TRIANGLES: u64 = Self::MOST_RECORDS / 3;
    /// The limit of numbering vertices or objects.
    pub const MOST_RECORDS: u64 = u32::MAX as u64 - 1;
}

impl ImportLimits {
    /// The memory that an import of files of this many bytes may take, bytes.
    #[must_use]
    pub fn memory(&self, files: u64) -> u64 {
        let attributes = self.attribute_bytes.saturating_mul(8);
        let parts = [(files, 64), (self.triangles, 64), (self.vertices, 128), (self.objects, 512)];
        let sum = |sum: u64, (count, each): (u64, u64)| sum.saturating_add(count.saturating_mul(each));
        parts.into_iter().fold(attributes.saturating_add(64 << 20), sum)
    }
}

impl Default for ImportLimits {
    /// Far beyond any known plant: the largest models that this was made for store a few million triangles.
    fn default() -> Self {
        Self {
            triangles: 200_000_000,
            vertices: 200_000_000,
            objects: 20_000_000,
            depth: 1_000,
            attribute_bytes: 512 << 20,
        }
    }
}

/// A limited quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Resource {
    /// [`ImportLimits::triangles`].
    Triangles,
    /// [`ImportLimits::vertices`].
    Vertices,
    /// [`ImportLimits::objects`].
    Objects,
    /// [`ImportLimits::depth`].
    Depth,
    /// [`ImportLimits::attribute_bytes`].
    AttributeBytes,
}

impl Resource {
    /// The flag of `trimaran import` that raises the limit.
    #[must_use]
    pub const fn flag(self) -> &'static str {
        match self {
            Self::Triangles => "--max-triangles",
            Self::Vertices => "--max-vertices",
            Self::Objects => "--max-objects",
            Self::Depth => "--max-depth",
            Self::AttributeBytes => "--max-attribute-bytes",
        }
    }
}

impl fmt::Display for Resource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Triangles => "triangles",
            Self::Vertices => "vertices",
            Self::Objects => "objects",
            Self::Depth => "levels of nesting",
            Self::AttributeBytes => "bytes of attributes",
        })
    }
}

/// A file exceeds a limit.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "with {user} the import has more than {limit} {resource}; if the model is as large as that, allow more with {}, \
     or import it as several scenes",
    resource.flag()
)]
pub struct OverBudget {
    /// The exceeded quantity.
    pub resource: Resource,
    /// How much is allowed.
    pub limit: u64,
    /// The requester: a mesh, a node, a group, an object.
    pub user: String,
}

/// Whether there is room for what was asked for.
type Allowed = Result<(), OverBudget>;

/// The requests of one import's files so far.
#[derive(Debug, Default)]
pub(super) struct Budget {
    limits: ImportLimits,
    triangles: AtomicU64,
    vertices: AtomicU64,
    objects: AtomicU64,
    attribute_bytes: AtomicU64,
    looked_for: Mutex<BTreeSet<PathBuf>>,
}

impl Budget {
    pub(super) fn new(limits: ImportLimits) -> Self {
        Self {
            limits: ImportLimits {
                triangles: limits.triangles.min(ImportLimits::MOST_TRIANGLES),
                vertices: limits.vertices.min(ImportLimits::MOST_RECORDS),
                objects: limits.objects.min(ImportLimits::MOST_RECORDS),
                ..limits
            },
            ..Self::default()
        }
    }

    /// The bytes of a regular file: the model's, or one beside it.
    pub(super) fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.open(path)?.read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Opens a regular file: the model's, or one beside it. Refuses pipes and devices, which may never end.
    pub(super) fn open(&self, path: &Path) -> io::Result<File> {
        self.look_for(path);
        if fs::metadata(path)?.is_file() {
            File::open(path)
        } else {
            Err(io::Error::other("it is not a regular file"))
        }
    }

    /// Notes that the model depends on a file, even if it does not exist.
    pub(super) fn look_for(&self, path: &Path) {
        // A panic elsewhere leaves the set intact.
        let mut looked_for = self.looked_for.lock().unwrap_or_else(PoisonError::into_inner);
        if !looked_for.contains(path) {
            looked_for.insert(path.to_owned());
        }
    }

    /// All files that the model depends on so far.
    pub(super) fn looked_for(&self) -> Vec<PathBuf> {
        self.looked_for.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    /// Counts a mesh's triangles and vertices; `user` is named if they exceed the limit.
    pub(super) fn mesh(&self, triangles: u64, vertices: u64, user: impl Fn() -> String) -> Allowed {
        take(&self.triangles, triangles, Resource::Triangles, self.limits.triangles, &user)?;
        take(&self.vertices, vertices, Resource::Vertices, self.limits.vertices, &user)
    }

    /// Counts a texture's texels, four per vertex. Returns whether there is room for them.
    pub(super) fn texels(&self, texels: u64) -> bool {
        self.mesh(0, texels.div_ceil(TEXELS_A_VERTEX), String::new).is_ok()
    }

    /// Counts `count` objects, each with a name of `name_length` bytes.
    pub(super) fn objects(&self, count: u64, name_length: usize, user: impl Fn() -> String) -> Allowed {
        let each = 1 + name_length as u64 / NAME_UNIT;
        take(&self.objects, count.saturating_mul(each), Resource::Objects, self.limits.objects, &user)
    }

    /// Counts this many more bytes of attributes.
    pub(super) fn attributes(&self, bytes: u64, user: impl Fn() -> String) -> Allowed {
        take(&self.attribute_bytes, bytes, Resource::AttributeBytes, self.limits.attribute_bytes, &user)
    }

    /// Checks a nesting depth.
    pub(super) fn depth(&self, depth: usize, user: impl Fn() -> String) -> Allowed {
        if depth as u64 <= u64::from(self.limits.depth) {
            return Ok(());
        }
        Err(OverBudget { resource: Resource::Depth, limit: self.limits.depth.into(), user: user() })
    }
}

/// Adds to a count unless it would exceed the limit. The counter guards no other memory, so the memory order
/// does not matter.
fn take(used: &AtomicU64, more: u64, resource: Resource, limit: u64, user: &dyn Fn() -> String) -> Allowed {
    let add = |used: u64| used.checked_add(more).filter(|&sum| sum <= limit);
    match used.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add) {
        Ok(_) => Ok(()),
        Err(_) => Err(OverBudget { resource, limit, user: user() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn budget() -> Budget {
        Budget::new(ImportLimits { triangles: 10, vertices: 20, objects: 5, depth: 3, attribute_bytes: 9 })
    }

    #[test]
    fn what_is_refused_is_not_counted_and_names_its_user_and_flag() {
        let budget = budget();
        let user = || "the pump".to_owned();
        assert_eq!(budget.mesh(10, 5, user), Ok(()));
        let error = budget.mesh(1, 0, user).unwrap_err();
        assert_eq!((error.resource, error.limit), (Resource::Triangles, 10));
        let said = error.to_string();
        assert!(said.contains("the pump") && said.contains("--max-triangles"), "{said}");
        assert_eq!(budget.mesh(0, 15, user), Ok(()));
        assert_eq!(budget.mesh(0, u64::MAX, user).unwrap_err().resource, Resource::Vertices);
        assert_eq!(budget.mesh(0, 1, user).unwrap_err().resource, Resource::Vertices);
    }

    #[test]
    fn a_long_name_counts_as_objects() {
        let budget = budget();
        assert_eq!(budget.objects(2, 255, String::new), Ok(()));
        assert_eq!(budget.objects(1, 3 * 256, String::new).unwrap_err().resource, Resource::Objects);
        assert_eq!(budget.objects(1, 2 * 256, String::new), Ok(()));
        assert_eq!(budget.objects(u64::MAX, 512, String::new).unwrap_err().limit, 5);
    }

    #[test]
    fn bytes_of_attributes_count() {
        let budget = budget();
        assert_eq!(budget.attributes(9, String::new), Ok(()));
        let error = budget.attributes(1, || "group \"/A\"".to_owned()).unwrap_err();
        assert_eq!((error.resource, error.limit), (Resource::AttributeBytes, 9));
        assert!(error.to_string().contains("--max-attribute-bytes"), "{error}");
    }

    #[test]
    fn a_folder_is_not_a_file_and_a_pipe_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let error = budget().read(folder.path()).unwrap_err();
        assert!(error.to_string().contains("not a regular file"), "{error}");
        let pipe = folder.path().join("pipe.att");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        let budget = budget();
        assert!(budget.read(&pipe).is_err() && budget.read(&folder.path().join("lost")).is_err());
        assert_eq!(budget.looked_for(), [folder.path().join("lost"), pipe]);
    }

    #[test]
    fn nesting_has_an_end() {
        assert_eq!(budget().depth(3, String::new), Ok(()));
        assert_eq!(budget().depth(4, String::new).unwrap_err().resource, Resource::Depth);
    }

    #[test]
    fn no_limit_is_beyond_what_indices_can_number() {
        let most = u64::MAX;
        let all =
            ImportLimits { triangles: most, vertices: most, objects: most, depth: 9, attribute_bytes: most };
        let budget = Budget::new(all);
        assert!(budget.mesh(1 << 31, 0, String::new).is_err());
        assert!(budget.mesh(0, 1 << 32, String::new).is_err());
        assert!(budget.objects(1 << 32, 0, String::new).is_err());
    }
}
