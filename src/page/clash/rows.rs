//! The rows of a list of clashes.

use std::{borrow::Cow, collections::BTreeMap, ops::Range, sync::Arc};

use serde::Serialize;
use thiserror::Error;
use trimaran_proto::ObjectSet;
use trimaran_scene::{GroupLevel, Hierarchy, ReadError, Scene, clearance::Clearance};

use super::view::{self, ClashCamera};
use crate::page::{
    finding::{Index, IndexError, Query, QueryError},
    parts::{NAME, Parts, cut},
};

/// A clash with what people want to know of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClashRow {
    /// `hard`, if the surfaces intersect or touch; else `clearance`.
    pub kind: &'static str,
    /// The shortest distance of the surfaces, metres.
    pub distance: f64,
    /// Its error due to rounded coordinates, metres.
    pub error: f64,
    /// Both objects, in the order of the sets.
    pub parts: [ClashPart; 2],
    /// A closest point of each: metres in the world, y up.
    pub points: [[f64; 3]; 2],
    /// The same points in the plant's coordinates: east, north and up, metres.
    pub plant: [[f64; 3]; 2],
    /// An eye that sees it.
    pub camera: ClashCamera,
    /// The fragment of a page's address that shows it: `#v=...`.
    pub view: String,
}

/// An object of a clash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ClashPart {
    /// Its number.
    pub object: u32,
    /// Its name; empty without one.
    pub name: String,
    /// The names of the groups that it is in, from the outermost, which is the file.
    pub path: Vec<String>,
}

/// The columns of [`ClashRow::to_csv`].
pub const CLASH_COLUMNS: &str = "kind,distance_m,error_m,name_1,path_1,object_1,name_2,path_2,object_2,\
                                 x_1,y_1,z_1,x_2,y_2,z_2,\
                                 east_1_m,north_1_m,up_1_m,east_2_m,north_2_m,up_2_m,view\n";

/// The most groups of a path in a page's list: the file, and the innermost.
const PATH: usize = 16;
/// Stands between the groups of a path.
const WITHIN: &str = " > ";

/// Finds a scene's objects by names, and names those that clash.
#[derive(Debug)]
pub struct ClashNames {
    scene: Arc<Scene>,
    parts: Parts,
    index: Index,
}

/// A scene's parts cannot be found by a query.
#[derive(Debug, Error)]
pub enum ClashNamesError {
    /// The scene cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Its texts are too large.
    #[error(transparent)]
    Index(#[from] IndexError),
}

impl ClashNames {
    /// Of this scene.
    ///
    /// # Errors
    /// If its hierarchy cannot be read, or its texts are too large for an index.
    pub fn new(scene: &Arc<Scene>) -> Result<Self, ClashNamesError> {
        let parts = Parts::new(Arc::clone(scene))?;
        let names = (0..scene.objects().len() as u32).map(|id| scene.object_name(id).unwrap_or_default());
        let index = Index::new(parts.hierarchy(), names)?;
        Ok(Self { scene: Arc::clone(scene), parts, index })
    }

    /// The objects that a query means: all objects of each part that the page's search finds by it.
    ///
    /// # Errors
    /// If the query is wrong.
    pub fn objects(&self, query: &str) -> Result<ObjectSet, QueryError> {
        let found = self.index.find(&Query::parse(query)?, &|| false)?;
        Ok(found.unwrap_or_default().objects)
    }

    /// For each object the run of objects of its group at a level.
    #[must_use]
    pub fn groups_at(&self, level: GroupLevel) -> Vec<Range<u32>> {
        self.parts.hierarchy().groups_at(level, self.scene.objects().len() as u32)
    }

    /// The rows of clashes, in their order. `scene_name` is the name of the model in links.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub fn rows(&self, scene_name: &str, clashes: &[Clearance]) -> Result<Vec<ClashRow>, ReadError> {
        rows(&self.scene, self.parts.hierarchy(), scene_name, clashes)
    }
}

/// The rows of clashes, in their order.
pub(super) fn rows(
    scene: &Scene,
    hierarchy: &Hierarchy,
    scene_name: &str,
    clashes: &[Clearance],
) -> Result<Vec<ClashRow>, ReadError> {
    let innermost = innermost(hierarchy, clashes);
    let plant = scene.coordinates()?.plant;
    let part = |object: u32| {
        let name = scene.object_name(object).unwrap_or_default().to_owned();
        let group = |id: u32| hierarchy.groups.get(id as usize);
        let around = innermost.get(&object).copied().flatten();
        let ids = std::iter::successors(around, |id| group(*id)?.parent);
        let mut path: Vec<String> = ids.filter_map(|id| Some(group(id)?.name.to_string())).collect();
        path.reverse();
        ClashPart { object, name, path }
    };
    let row = |clash: &Clearance| {
        let camera = ClashCamera::of(scene, clash);
        ClashRow {
            kind: if clash.is_hard() { "hard" } else { "clearance" },
            distance: clash.distance,
            error: clash.rounding,
            parts: clash.objects.map(part),
            points: clash.points.map(|point| point.to_array()),
            plant: clash.points.map(|point| plant.to_plant(point).to_array()),
            camera,
            view: format!("#v={}", view::link(scene, scene_name, clash, &camera)),
        }
    };
    scene.reading(|| clashes.iter().map(row).collect())
}

/// The innermost group of each object that clashes.
fn innermost(hierarchy: &Hierarchy, clashes: &[Clearance]) -> BTreeMap<u32, Option<u32>> {
    let objects = clashes.iter().flat_map(|clash| clash.objects);
    let mut found: BTreeMap<u32, Option<u32>> = objects.map(|object| (object, None)).collect();
    // Groups stand behind those that they are in.
    for (id, group) in (0..).zip(&hierarchy.groups) {
        for (_, innermost) in found.range_mut(group.objects.clone()) {
            *innermost = Some(id);
        }
    }
    found
}

impl ClashRow {
    /// The row as a line of comma-separated values (RFC 4180), with the columns [`CLASH_COLUMNS`].
    #[must_use]
    pub fn to_csv(&self) -> String {
        let Self { kind, distance, error, parts, points, plant, view, .. } = self;
        let mut cells: Vec<String> = vec![(*kind).to_owned(), metres(*distance), format!("{error:.1e}")];
        for ClashPart { object, name, path } in parts {
            cells.extend([quoted(name).into(), path_cell(path), object.to_string()]);
        }
        cells.extend([points, plant].into_iter().flat_map(|of| of.as_flattened()).map(|at| metres(*at)));
        cells.push(view.clone());
        cells.join(",") + "\n"
    }

    /// With names and paths that fit in a page's list.
    pub(super) fn cut(mut self) -> Self {
        for ClashPart { name, path, .. } in &mut self.parts {
            *name = cut(name, NAME);
            // The outermost is the file.
            let middle = 1..path.len().saturating_sub(PATH - 1).max(1);
            path.drain(middle.start.min(path.len())..middle.end.min(path.len()));
            path.iter_mut().for_each(|group| *group = cut(group, NAME));
        }
        self
    }
}

/// The last line of a list: how many clashes were ignored, as both objects are in the same group of a level.
#[must_use]
pub fn ignored_csv(count: usize, level: GroupLevel) -> String {
    let rest = ",".repeat(CLASH_COLUMNS.matches(',').count().saturating_sub(3));
    format!("ignored,,,{count} in the same {}{rest}\n", level.as_str())
}

/// The groups of a path as one cell.
pub(super) fn path_cell(path: &[String]) -> String {
    quoted(&path.join(WITHIN)).into()
}

/// In micrometres.
fn metres(length: f64) -> String {
    format!("{length:.6}")
}

/// A text as one cell.
fn quoted(text: &str) -> Cow<'_, str> {
    match text.contains(['"', ',', '\r', '\n']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")).into(),
        false => text.into(),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use glam::DVec3;
    use trimaran_cook::{
        CookOptions, Model, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_scene::{Extent, Group, PlantFrame};

    use super::*;

    pub(in crate::page::clash) fn names() -> ClashNames {
        let mut model: Model = plant(&PlantOptions::small(7));
        let count = model.objects.len() as u32;
        let group = |name: &str, parent, objects| Group {
            name: name.into(),
            parent,
            objects,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        model.hierarchy.groups = vec![
            group("plant.RVM", None, 0..count),
            group("/ZONE \"1\", north", Some(0), 1..4),
            group("/PIPE-7", Some(1), 2..4),
        ];
        model.coordinates.plant = PlantFrame { origin: [100.0, 200.0, 30.0], north_deg: 90.0 };
        model.objects[2].name = "FLANGE 1 of BRANCH, or\nnot".to_owned();
        ClashNames::new(&Arc::new(cook(&model, &CookOptions::default(), &()).unwrap())).unwrap()
    }

    fn clash(objects: [u32; 2], distance: f64) -> Clearance {
        Clearance { objects, distance, points: [DVec3::ZERO, DVec3::X * distance], rounding: 2e-6 }
    }

    #[test]
    fn a_row_has_names_paths_and_a_view() {
        let names = names();
        let rows = names.rows("plant", &[clash([2, 5], 0.0125), clash([1, 2], 1e-6)]).unwrap();
        let path = |row: usize, part: usize| rows[row].parts[part].path.join("|");
        assert_eq!(path(0, 0), "plant.RVM|/ZONE \"1\", north|/PIPE-7");
        assert_eq!((path(0, 1), path(1, 0)), ("plant.RVM".into(), "plant.RVM|/ZONE \"1\", north".into()));
        assert_eq!(rows.iter().map(|row| row.kind).collect::<Vec<_>>(), ["clearance", "hard"]);
        let csv = rows[0].to_csv();
        let start = "clearance,0.012500,2.0e-6,\"FLANGE 1 of BRANCH, or\nnot\",\
                     \"plant.RVM > /ZONE \"\"1\"\", north > /PIPE-7\",2,";
        assert!(csv.starts_with(start), "{csv}");
        // North is where x leads, and the scene's origin is at E 100, N 200, U 30.
        let places = ",5,0.000000,0.000000,0.000000,0.012500,0.000000,0.000000,\
                      100.000000,200.000000,30.000000,100.000000,200.012500,30.000000,#v=";
        assert!(csv.contains(places), "{csv}");
        assert_eq!(rows[0].plant[0], [100.0, 200.0, 30.0]);
        assert!(csv.ends_with('\n') && CLASH_COLUMNS.matches(',').count() == 21);
        let footer = ignored_csv(3, GroupLevel::Equipment);
        assert!(footer.starts_with("ignored,,,3 in the same equipment,,") && footer.ends_with(",\n"));
        assert_eq!(footer.matches(',').count(), 21);
        assert_eq!(names.objects("pipe 7").unwrap().iter().collect::<Vec<_>>(), [2, 3]);
    }

    #[test]
    fn a_page_gets_short_names_and_paths() {
        let part = |path: usize| ClashPart {
            object: 1,
            name: "n".repeat(1 << 16),
            path: (0..path).map(|at| format!("{at}{}", "g".repeat(1 << 12))).collect(),
        };
        let row = names().rows("plant", &[clash([2, 5], 0.1)]).unwrap().remove(0);
        let cut = ClashRow { parts: [part(1000), part(0)], ..row.clone() }.cut();
        let path = &cut.parts[0].path;
        assert!(path.len() == PATH && path[0].starts_with("0g") && path[PATH - 1].starts_with("999g"));
        assert!(serde_json::to_vec(&cut).unwrap().len() < 8 << 10);
        assert_eq!(ClashRow { parts: [part(2), part(1)], ..row }.cut().parts[0].path.len(), 2);
    }
}
