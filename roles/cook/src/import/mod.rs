//! Imports files as a [`Model`]: glTF 2.0, AVEVA review files (RVM), Wavefront OBJ, STL and PLY;
//! STEP, IGES and IFC by converters.
//!
//! [`import`] takes any number of files and makes one model of them. It keeps the data of a walk (shape,
//! place, base colour, name), but not animation and materials beyond the base colour. The world of the result
//! is right-handed, y up, in metres, whatever the files' own frames are.
//!
//! Files are not trusted. No importer panics on bad bytes or allocates by a length field alone; each ends in
//! an [`ImportError`] that names the file, the place in it and the cause. [`ImportLimits`] bound the requests
//! of files, and so the memory and the time of an import. Parts that can be left out without a hole in the
//! model (points, lines, textures) are left out and counted in [`ImportReport::warnings`].

mod assemble;
mod budget;
mod cad;
mod error;
mod format;
mod gltf;
mod gzip;
mod hierarchy;
mod left_out;
mod neighbours;
mod obj;
mod ply;
mod polygon;
mod report;
mod rvm;
mod stl;
mod text;

use std::borrow::Cow;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use rayon::prelude::*;

pub use budget::{ImportLimits, NAME_UNIT, OverBudget, Resource};
pub use cad::{CadError, Converters, Engine};
pub use error::{FilePosition, ImportError};
pub use format::Format;
pub use gltf::GltfError;
pub use obj::ObjError;
pub use ply::PlyError;
pub use report::{ImportReport, Warning, WarningKind};
pub use rvm::RvmError;
pub use stl::StlError;
pub use text::NotText;
pub use trimaran_scene::{FileFrame, PlantFrame, UpAxis};

use self::budget::Budget;
use crate::Model;

/// The options of reading files.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// The largest distance of a tessellated surface from the true one, metres. No curve is cut finer than a
    /// ten-thousandth of its size. RVM, STEP, IGES and IFC have curved surfaces.
    pub chord_tolerance: f64,
    /// The upward axis; `None` is each format's own: y for glTF and OBJ, z for all others.
    pub up: Option<UpAxis>,
    /// Metres per unit of length; `None` is each format's own: 1 for OBJ and PLY, 0.001 for RVM and STL. glTF
    /// is in metres by its specification, STEP, IGES and IFC say their unit, and they ignore it.
    pub unit: Option<f64>,
    /// The plant's coordinates; `None` are those that a file says (IFC with a map conversion), or else those of
    /// the files. No part is moved by it.
    pub plant: Option<PlantFrame>,
    /// The limits.
    pub limits: ImportLimits,
    /// The programs that read STEP, IGES and IFC.
    pub converters: Converters,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            chord_tolerance: 1e-3,
            up: None,
            unit: None,
            plant: None,
            limits: ImportLimits::default(),
            converters: Converters::default(),
        }
    }
}

/// A model with the report of its import.
#[derive(Debug, Clone)]
pub struct Imported {
    /// The model, checked: [`Model::check`] holds.
    pub model: Model,
    /// Counts and warnings.
    pub report: ImportReport,
}

impl Imported {
    /// How many warnings are named when a model has nothing to draw.
    const REASONS: usize = 5;

    /// The model, if it has anything to draw.
    ///
    /// # Errors
    /// If it has nothing: names the files, and their warnings.
    pub fn with_objects(self) -> Result<Self, ImportError> {
        let meshes = &self.model.meshes;
        let mut drawn = self.model.objects.iter().filter_map(|object| meshes.get(object.mesh as usize));
        if drawn.any(|mesh| !assemble::draws_nothing(mesh)) {
            return Ok(self);
        }
        let files = self.model.sources.into_iter().map(|source| source.name).collect();
        let warnings = self.report.warnings.into_iter().take(Self::REASONS).collect();
        Err(ImportError::NothingToDraw { files, warnings })
    }
}

/// The progress of an import, after each file and while one is converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress<'a> {
    /// The file that was just read, or is converted.
    pub file: &'a Path,
    /// Files read so far.
    pub files_done: usize,
    /// Files in all.
    pub files: usize,
    /// How far the conversion of the file is, percent; none once the file is read.
    pub converted: Option<u8>,
}

/// Reads `paths` into one model: the files' objects one after the other, in the order given.
///
/// The format follows from the file's name, and its first bytes confirm it. Files are read in parallel.
/// `progress` is called after each, in the order in which they finish, and for each percent of a STEP, IGES
/// or IFC file. The result does not depend on that order.
///
/// # Errors
/// The first file, in the order given, that cannot be read; or invalid options.
pub fn import(
    paths: &[PathBuf],
    options: &ImportOptions,
    progress: &mut (dyn FnMut(Progress<'_>) + Send),
) -> Result<Imported, ImportError> {
    if paths.is_empty() {
        return Err(ImportError::NoFiles);
    }
    options.check()?;
    let budget = Budget::new(options.limits);
    let progress = Mutex::new((0, progress));
    let tell = |file: &Path, converted: Option<u8>| {
        // A callback that panicked has poisoned the lock; its panic is on its way up already.
        if let Ok(mut guard) = progress.lock() {
            guard.0 += usize::from(converted.is_none());
            let files_done = guard.0;
            (guard.1)(Progress { file, files_done, files: paths.len(), converted });
        }
    };
    let parts: Vec<_> = paths
        .par_iter()
        .map(|path| {
            let part = import_file(path, options, &budget, &|percent| tell(path, Some(percent)));
            tell(path, None);
            part
        })
        .collect();
    assemble::merge(&budget, options, paths.iter().map(PathBuf::as_path).zip(parts))
}

/// Reads one file that is in memory. `name` decides the format; files that it refers to are not read.
///
/// # Errors
/// If the file cannot be used, as with [`import`]; or invalid options.
pub fn import_bytes(name: &Path, bytes: &[u8], options: &ImportOptions) -> Result<Imported, ImportError> {
    options.check()?;
    let budget = Budget::new(options.limits);
    let part = read(name, None, bytes, options, &budget, &|_| {});
    assemble::merge(&budget, options, [(name, part)])
}

/// One file's part of the model, its objects in the world frame, with the report.
struct Part {
    model: Model,
    report: ImportReport,
}

fn import_file(
    path: &Path,
    options: &ImportOptions,
    budget: &Budget,
    progress: &dyn Fn(u8),
) -> Result<Part, ImportError> {
    let unread = |source| ImportError::Read { path: path.to_owned(), source };
    if Format::is_named_as_review(path) {
        // These may be larger than memory, so they are read in pieces.
        let file = budget.open(path).map_err(unread)?;
        let mut start = Vec::new();
        (&file).take(Format::START).read_to_end(&mut start).map_err(unread)?;
        let unpacked = gzip::unpacked(path, &start)?;
        Format::of(&unpacked.name, &unpacked.bytes)?;
        let mut part = rvm::import(Some(path), file, options, budget)
            .map_err(|source| ImportError::Rvm { path: path.to_owned(), source })?;
        part.model.coordinates.files = vec![options.frame_of(Format::Rvm)];
        return Ok(part);
    }
    let bytes = budget.read(path).map_err(unread)?;
    read(path, Some(path), &bytes, options, budget, progress)
}

/// Reads a file called `name`, at `path` if it is on disk.
fn read(
    name: &Path,
    path: Option<&Path>,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
    progress: &dyn Fn(u8),
) -> Result<Part, ImportError> {
    let unpacked = gzip::unpacked(name, bytes)?;
    let bytes = &*unpacked.bytes;
    let format = Format::of(&unpacked.name, bytes)?;
    let mut part = match format {
        Format::Gltf => gltf::import(path, bytes, options, budget)
            .map_err(|source| ImportError::Gltf { path: name.to_owned(), source: Box::new(source) }),
        Format::Obj => obj::import(path, bytes, options, budget)
            .map_err(|source| ImportError::Obj { path: name.to_owned(), source }),
        format @ (Format::Step | Format::Iges | Format::Ifc) => {
            let kind = match format {
                Format::Step => cad::Kind::Step,
                Format::Iges => cad::Kind::Iges,
                _ => cad::Kind::Ifc,
            };
            // The converter reads the file itself, unless it was packed.
            let path = path.filter(|_| matches!(unpacked.bytes, Cow::Borrowed(_)));
            cad::import(kind, &stem(&unpacked.name), path, bytes, options, budget, progress)
                .map_err(|source| ImportError::Cad { path: name.to_owned(), source })
        }
        Format::Stl => stl::import(&stem(&unpacked.name), bytes, options, budget)
            .map_err(|source| ImportError::Stl { path: name.to_owned(), source }),
        Format::Ply => ply::import(&stem(&unpacked.name), bytes, options, budget)
            .map_err(|source| ImportError::Ply { path: name.to_owned(), source }),
        Format::Rvm => rvm::import(path, Cursor::new(bytes), options, budget)
            .map_err(|source| ImportError::Rvm { path: name.to_owned(), source }),
    }?;
    part.model.coordinates.files = vec![options.frame_of(format)];
    if unpacked.behind > 0 {
        let detail = format!("{} bytes", unpacked.behind);
        part.report.warn_about(WarningKind::BehindPacked, &detail, 1);
    }
    Ok(part)
}

/// A file's name without its folder and its ending: the name of an object that has none.
fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

impl ImportOptions {
    fn check(&self) -> Result<(), ImportError> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        if !positive(self.chord_tolerance) {
            return Err(ImportError::Option { option: "chord tolerance", value: self.chord_tolerance });
        }
        match self.unit {
            Some(unit) if !positive(unit) => Err(ImportError::Option { option: "unit", value: unit }),
            _ => match self.plant {
                Some(plant) if !plant.is_sound() => Err(ImportError::Plant { plant }),
                _ => Ok(()),
            },
        }
    }

    /// The coordinates of a file of this format, read with these options.
    fn frame_of(&self, format: Format) -> FileFrame {
        let (up, unit) = match format {
            Format::Gltf => (UpAxis::Y, Some(1.0)),
            Format::Obj => (UpAxis::Y, Some(self.unit.unwrap_or(1.0))),
            Format::Ply => (UpAxis::Z, Some(self.unit.unwrap_or(1.0))),
            Format::Stl => (UpAxis::Z, Some(self.unit.unwrap_or(1e-3))),
            Format::Rvm => (UpAxis::Z, Some(self.unit.unwrap_or(rvm::USUAL_UNIT))),
            Format::Step | Format::Iges | Format::Ifc => (UpAxis::Z, None),
        };
        FileFrame { up: self.up.unwrap_or(up), metres_per_unit: unit }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;

    #[test]
    fn z_up_turns_into_y_up() {
        let map = ImportOptions::default().frame_of(Format::Ply).to_scene();
        assert_eq!(map.transform_point3(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(1.0, 3.0, -2.0));
        assert_eq!(map.matrix3.determinant(), 1.0);
    }

    #[test]
    fn options_outrank_the_format_except_where_it_is_in_metres() {
        let options = ImportOptions { up: Some(UpAxis::Y), unit: Some(0.01), ..Default::default() };
        for (format, unit) in [
            (Format::Gltf, Some(1.0)),
            (Format::Step, None),
            (Format::Iges, None),
            (Format::Obj, Some(0.01)),
            (Format::Rvm, Some(0.01)),
            (Format::Stl, Some(0.01)),
            (Format::Ply, Some(0.01)),
        ] {
            let frame = FileFrame { up: UpAxis::Y, metres_per_unit: unit };
            assert_eq!(options.frame_of(format), frame, "{format:?}");
        }
    }

    /// The point of a file is where its coordinates say.
    #[test]
    fn the_model_knows_the_coordinates_of_its_files_and_of_the_plant() {
        let plant = PlantFrame { origin: [1e6, 2e6, 30.0], north_deg: 17.0 };
        let corners = [DVec3::new(4000.0, 5000.0, 6000.0), DVec3::X * 100.0, DVec3::Y * 100.0];
        let [a, b, c] = corners.map(|corner| corner.to_array().map(|x| x.to_string()).join(" "));
        let obj = format!("v {a}\nv {b}\nv {c}\nf 1 2 3\n");
        let stl = format!(
            "solid a\nfacet\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\n\
                           endfacet\nendsolid a\n"
        );
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                           property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
                           end_header\n{a}\n{b}\n{c}\n3 0 1 2\n"
        );
        for (name, text) in [("a.obj", obj), ("a.stl", stl), ("a.ply", ply)] {
            for (up, unit) in [(None, None), (Some(UpAxis::Y), Some(0.0254)), (Some(UpAxis::Z), Some(2.0))] {
                let options = ImportOptions { up, unit, plant: Some(plant), ..Default::default() };
                let model = import_bytes(Path::new(name), text.as_bytes(), &options).unwrap().model;
                assert_eq!(model.coordinates.plant, plant);
                let [file] = model.coordinates.files[..] else { panic!("{name}: {:?}", model.coordinates) };
                let (object, mesh) = (&model.objects[0], &model.meshes[0]);
                let expected = corners.map(|corner| file.to_scene().transform_point3(corner));
                let place = |position: &Vec3| object.to_world.transform_point3(position.as_dvec3());
                let places: Vec<DVec3> = mesh.positions.iter().map(place).collect();
                for corner in expected {
                    let nearest = places.iter().map(|place| place.distance(corner)).fold(f64::MAX, f64::min);
                    assert!(nearest < 1e-3 * (1.0 + unit.unwrap_or(1.0)), "{name}: {corner} {places:?}");
                }
            }
        }
    }

    #[test]
    fn senseless_coordinates_of_a_plant_are_refused() {
        for plant in [
            PlantFrame { origin: [0.0, f64::NAN, 0.0], north_deg: 0.0 },
            PlantFrame { origin: [0.0; 3], north_deg: 400.0 },
        ] {
            let options = ImportOptions { plant: Some(plant), ..Default::default() };
            let error = import_bytes(Path::new("a.obj"), b"v 0 0 0", &options).unwrap_err();
            assert!(matches!(error, ImportError::Plant { .. }), "{error}");
        }
    }

    #[test]
    fn senseless_options_are_refused() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let options = ImportOptions { chord_tolerance: bad, ..Default::default() };
            assert!(matches!(options.check(), Err(ImportError::Option { option: "chord tolerance", .. })));
            let options = ImportOptions { unit: Some(bad), ..Default::default() };
            assert!(matches!(options.check(), Err(ImportError::Option { option: "unit", .. })));
        }
    }

    #[test]
    fn no_files_is_an_error() {
        let result = import(&[], &ImportOptions::default(), &mut |_| {});
        assert!(matches!(result, Err(ImportError::NoFiles)));
    }
}
