//! The imported model: meshes, objects that place them, and their sources.

use glam::{DAffine3, Vec3};
use thiserror::Error;
use trimaran_scene::{Coordinates, Hierarchy, Rgba8, SceneError};

/// Triangles in a local frame, metres. Objects place it; several may share it.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Vertex positions about the mesh's own origin, metres.
    pub positions: Vec<Vec3>,
    /// One colour per vertex; a colour change duplicates vertices.
    pub colours: Vec<Rgba8>,
    /// Corner indices into `positions`, three per triangle.
    pub indices: Vec<u32>,
}

/// A mesh placed in the world: one part, to an engineer.
#[derive(Debug, Clone)]
pub struct Object {
    /// Index into [`Model::meshes`].
    pub mesh: u32,
    /// Mesh frame to world frame (right-handed, y up, metres). Any invertible affine map: sheared and
    /// mirrored ones too.
    pub to_world: DAffine3,
    /// The part's name in its file; empty if it has none.
    pub name: String,
    /// Index into [`Model::sources`].
    pub source: u32,
    /// The part's index in its source file: the glTF node, the RVM group, the OBJ object.
    pub source_index: u32,
}

/// A file that objects came from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The file's name without its folder.
    pub name: String,
}

/// A model in memory: the output of importers and generators, and the input of cooking.
#[derive(Debug, Clone, Default)]
pub struct Model {
    /// The meshes. Importers make no two equal ones, but nothing depends on it.
    pub meshes: Vec<Mesh>,
    /// The objects, in file order.
    pub objects: Vec<Object>,
    /// The files.
    pub sources: Vec<Source>,
    /// The grouping of the objects, and their attributes.
    pub hierarchy: Hierarchy,
    /// The coordinates that people know.
    pub coordinates: Coordinates,
}

/// Why a model is unfit for cooking.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A mesh's arrays are inconsistent: an index past its vertices, a colour list of another length, a stray
    /// corner.
    #[error("mesh {mesh} is malformed: {what}")]
    Mesh {
        /// Index of the mesh.
        mesh: usize,
        /// The error.
        what: &'static str,
    },
    /// An object cannot be placed.
    #[error("object {object} ({name:?} in {source_name:?}) cannot be placed: {what}")]
    Object {
        /// Index of the object.
        object: usize,
        /// Its name.
        name: String,
        /// The file it came from.
        source_name: String,
        /// The error.
        what: &'static str,
    },
    /// Groups are not properly nested.
    #[error("the hierarchy of objects is malformed: {0}")]
    Hierarchy(#[source] SceneError),
}

impl Model {
    /// Checks the requirements of cooking: indices in range, finite positions, finite and invertible
    /// placements.
    ///
    /// # Errors
    /// The first mesh or object that breaks a rule.
    pub fn check(&self) -> Result<(), ModelError> {
        for (index, mesh) in self.meshes.iter().enumerate() {
            mesh.check().map_err(|what| ModelError::Mesh { mesh: index, what })?;
        }
        for (index, object) in self.objects.iter().enumerate() {
            self.check_object(object).map_err(|what| ModelError::Object {
                object: index,
                name: object.name.clone(),
                source_name: self
                    .sources
                    .get(object.source as usize)
                    .map(|s| s.name.clone())
                    .unwrap_or_default(),
                what,
            })?;
        }
        self.hierarchy.check(self.objects.len() as u32).map_err(ModelError::Hierarchy)
    }

    /// The number of triangles as placed: a mesh counts once for each of its objects.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        let placed = self.objects.iter().filter_map(|object| self.meshes.get(object.mesh as usize));
        placed.map(Mesh::triangle_count).sum()
    }

    fn check_object(&self, object: &Object) -> Result<(), &'static str> {
        let determinant = object.to_world.matrix3.determinant();
        if object.mesh as usize >= self.meshes.len() {
            Err("its mesh does not exist")
        } else if object.source as usize >= self.sources.len() {
            Err("its source file does not exist")
        } else if !object.to_world.is_finite() {
            Err("its matrix has a value that is not finite")
        } else if determinant == 0.0 || !determinant.is_finite() {
            Err("its matrix is singular")
        } else {
            Ok(())
        }
    }
}

impl Mesh {
    /// The number of triangles.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    fn check(&self) -> Result<(), &'static str> {
        if self.colours.len() != self.positions.len() {
            Err("it has not one colour a vertex")
        } else if !self.indices.len().is_multiple_of(3) {
            Err("its indices are not a multiple of three")
        } else if self.indices.iter().any(|&i| i as usize >= self.positions.len()) {
            Err("an index points past its vertices")
        } else if !self.positions.iter().all(|p| p.is_finite()) {
            Err("a position is not finite")
        } else {
            Ok(())
        }
    }
}
