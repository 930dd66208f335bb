//! STEP, IGES and IFC: exact surfaces, which a program of its own cuts into triangles.
//!
//! The programs are `trimaran-occt`, by Open CASCADE, and `trimaran-ifc`, by IfcOpenShell. Their sources in
//! `roles/cook/occt` and `roles/cook/ifc` say how they are called, which is the same way. They write glTF,
//! which is read as any other: names, colours, hierarchy, instances and attributes come from there. The
//! engines may crash or hang on a damaged file, and their memory cannot be counted beforehand. So each is a
//! process with a limit of its memory and a timeout.

mod engine;
mod error;
mod process;

use std::fs;
use std::path::Path;
use std::process::Command;

pub use engine::{Converters, Engine};
pub use error::CadError;

use super::budget::Budget;
use super::report::WarningKind;
use super::{Format, ImportOptions, Part, PlantFrame, UpAxis, gltf};

/// A format of exact surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Kind {
    Step,
    Iges,
    Ifc,
}

impl Kind {
    const fn engine(self) -> Engine {
        match self {
            Self::Step | Self::Iges => Engine::OpenCascade,
            Self::Ifc => Engine::IfcOpenShell,
        }
    }

    const fn format(self) -> Format {
        match self {
            Self::Step => Format::Step,
            Self::Iges => Format::Iges,
            Self::Ifc => Format::Ifc,
        }
    }

    /// Its name in calls of the programs.
    const fn word(self) -> &'static str {
        match self {
            Self::Step => "step",
            Self::Iges => "iges",
            Self::Ifc => "ifc",
        }
    }
}

/// Converts a file and reads the result. `stem` is the name of parts that have none and are in nothing that
/// has one. `path` is where the file is on disk, if it is; `progress` gets percents.
pub(super) fn import(
    kind: Kind,
    stem: &str,
    path: Option<&Path>,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
    progress: &dyn Fn(u8),
) -> Result<Part, CadError> {
    let engine = kind.engine();
    let program = options.converters.program(engine).ok_or(CadError::NoConverter { engine })?;
    let folder = tempfile::Builder::new().prefix("trimaran-").tempdir().map_err(CadError::Folder)?;
    let input = match path {
        Some(path) => path.to_owned(),
        None => {
            let input = folder.path().join("input");
            fs::write(&input, bytes).map_err(CadError::Folder)?;
            input
        }
    };
    let up = match options.frame_of(kind.format()).up {
        UpAxis::Y => "y",
        UpAxis::Z => "z",
    };
    let memory = options.limits.memory(bytes.len() as u64);
    let mut command = Command::new(program);
    command.arg(kind.word()).arg(&input).arg(folder.path());
    command.args([&*options.chord_tolerance.to_string(), up, &*memory.to_string(), stem]);
    let mut left_out = Vec::new();
    let mut plant = PlantFrame::default();
    process::run(&mut command, engine, options.converters.timeout, memory, |line| {
        if let Some(said) = line.strip_prefix("plant ").and_then(place) {
            plant = said;
        }
        let mut words = line.splitn(3, ' ');
        let (word, number) = (words.next(), words.next().and_then(|number| number.parse::<u64>().ok()));
        let (Some(word), Some(number)) = (word, number) else { return };
        let kind = match word {
            "progress" => return progress(number.min(100) as u8),
            "unmeshed" => WarningKind::SurfaceUnmeshed,
            "unparsed" => WarningKind::EntityLeftOut,
            "spaces" => WarningKind::SpaceLeftOut,
            "unread" => WarningKind::PropertiesUnread,
            "unplaced" => WarningKind::MapUnread,
            "scaled" => WarningKind::MapScaled,
            _ => return,
        };
        left_out.push((kind, number, words.next().unwrap_or_default().to_owned()));
    })?;
    let made = fs::read(folder.path().join("model.glb")).map_err(CadError::Folder)?;
    let frame = ImportOptions { up: None, ..options.clone() };
    let mut part = gltf::import(None, &made, &frame, budget).map_err(Box::new)?;
    part.model.coordinates.plant = plant;
    for (kind, count, name) in left_out {
        part.report.warn_many(kind, "", &name, count);
    }
    Ok(part)
}

/// East, north and up of a model's origin, and north.
fn place(words: &str) -> Option<PlantFrame> {
    let numbers: Vec<f64> = words.split(' ').map(str::parse).collect::<Result<_, _>>().ok()?;
    let [e, n, u, north_deg] = numbers[..] else { return None };
    Some(PlantFrame { origin: [e, n, u], north_deg }).filter(PlantFrame::is_sound)
}
