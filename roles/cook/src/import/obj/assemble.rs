//! Makes objects with their own meshes from an OBJ file's faces.

use std::collections::{BTreeMap, HashMap};

use glam::{DAffine3, DVec3};

use super::faults::Faults;
use super::materials::Material;
use super::parse::{Face, Heading, Parsed, Run, UNNAMED};
use super::tints::Scale;
use crate::import::assemble::{GREY, centred, draws_nothing, is_in_reach, place_own, rgba};
use crate::import::budget::Budget;
use crate::import::hierarchy::{Branch, groups};
use crate::import::polygon::Triangulator;
use crate::import::report::{ImportReport, Warning, WarningKind};
use crate::import::{OverBudget, Part};
use crate::lists::at;
use trimaran_scene::Rgba8;

/// How many undefined materials are named.
const MOST_NAMED: usize = 100;

/// Adds the objects of a file to a part.
pub(super) fn assemble(
    mut parsed: Parsed,
    to_world: &DAffine3,
    budget: &Budget,
    faults: &mut Faults,
    part: &mut Part,
) -> Result<(), OverBudget> {
    let mut undefined = Undefined::of(parsed.materials.settle());
    for vertex in &mut parsed.vertices {
        *vertex = to_world.transform_point3(*vertex);
    }
    let mut shape = Shape {
        places: &parsed.vertices,
        seen: vec![[0; 2]; parsed.vertices.len()],
        run: 0,
        used: Vec::new(),
        corners: Vec::new(),
        faces: Vec::new(),
    };
    let tints = parsed.tints.scale();
    let mut triangulator = Triangulator::default();
    let (mut faces, mut corners) = (parsed.faces.as_slice(), parsed.corners.as_slice());
    let mut runs = parsed.runs.iter().peekable();
    for (index, heading) in (0..).zip(&parsed.objects) {
        let name = heading.name(&parsed.outers);
        shape.clear();
        while let Some(run) = runs.next_if(|run| run.object == index) {
            let of_run = faces.split_off(..run.faces as usize).unwrap_or_default();
            shape.add(run, of_run, &mut corners, |line, what| {
                faults.note(WarningKind::FaceLeftOut, "", line, name, || what);
            });
            if run.faces > 0 {
                undefined.used(run.material, name);
            }
        }
        let triangles = shape.faces.iter().map(|&corners| u64::from(corners.saturating_sub(2))).sum();
        budget.mesh(triangles, shape.used.len() as u64, || format!("object {name:?}"))?;
        let (positions, indices) = shape.triangles(&mut triangulator);
        let colour =
            |&(vertex, material): &(u32, u32)| colour(&tints, vertex, parsed.materials.get(material));
        let colours = shape.used.iter().map(colour).collect();
        let (mesh, origin) = centred(&positions, colours, indices);
        if draws_nothing(&mesh) {
            part.report.warn_of(WarningKind::EmptyObject, "", name);
            continue;
        }
        place_own(&mut part.model, mesh, origin, name, index);
    }
    let leaves: Vec<u32> = part.model.objects.iter().map(|object| object.source_index).collect();
    part.model.hierarchy.groups = groups(branches(&parsed.objects, &parsed.outers), &leaves);
    part.report.warn(WarningKind::LargePolygon, triangulator.large_polygons());
    undefined.report(&mut part.report);
    Ok(())
}

impl Heading {
    fn name<'n>(&'n self, outers: &'n [String]) -> &'n str {
        let outer = self.outer.and_then(|outer| outers.get(outer as usize));
        match (self.group.as_str(), outer) {
            ("", Some(outer)) => outer,
            ("", None) => UNNAMED,
            (group, _) => group,
        }
    }
}

/// The `o` names with groups in them.
fn branches(objects: &[Heading], outers: &[String]) -> Vec<Branch> {
    let mut branches = Vec::new();
    let mut start = 0;
    for run in objects.chunk_by(|a, b| a.outer == b.outer) {
        let end = start + run.len() as u32;
        let outer = run.first().and_then(|first| outers.get(first.outer? as usize));
        if let Some(name) = outer.filter(|_| run.iter().any(|object| !object.group.is_empty())) {
            branches.push(Branch {
                name: name.clone(),
                parent: None,
                leaves: start..end,
                attributes: Vec::new(),
            });
        }
        start = end;
    }
    branches
}

/// The current object; its memory is reused for all of them.
struct Shape<'p> {
    /// The file's vertices, in the world frame.
    places: &'p [DVec3],
    /// For each vertex the last run that used it, and its number in that object.
    seen: Vec<[u32; 2]>,
    run: u32,
    /// The object's vertices: number in the file, and material.
    used: Vec<(u32, u32)>,
    /// The consecutive corners of its faces: numbers among `used`.
    corners: Vec<u32>,
    /// How many corners each of its faces has.
    faces: Vec<u32>,
}

impl Shape<'_> {
    fn clear(&mut self) {
        self.used.clear();
        self.corners.clear();
        self.faces.clear();
    }

    /// Takes the faces of a run, whose corners are next, except those that cannot be drawn.
    fn add(
        &mut self,
        run: &Run,
        faces: &[Face],
        corners: &mut &[u32],
        mut left_out: impl FnMut(u32, String),
    ) {
        self.run += 1;
        for face in faces {
            let of_face = corners.split_off(..face.corners as usize).unwrap_or_default();
            let place = |vertex: &u32| self.places.get(*vertex as usize);
            let is_sound = |place: Option<&DVec3>| place.is_some_and(|&place| is_in_reach(place));
            match of_face.iter().find(|vertex| !is_sound(place(vertex))) {
                Some(&vertex) => {
                    let number = u64::from(vertex) + 1;
                    left_out(
                        face.line,
                        match place(&vertex) {
                            Some(_) => format!("vertex {number} has no finite place, or is too far away"),
                            None => format!("vertex {number} of {}", self.places.len()),
                        },
                    );
                }
                None => {
                    for &vertex in of_face {
                        self.corner(vertex, run.material);
                    }
                    self.faces.push(face.corners);
                }
            }
        }
    }

    fn corner(&mut self, vertex: u32, material: u32) {
        let Some([run, number]) = self.seen.get_mut(vertex as usize) else { return };
        if *run != self.run {
            [*run, *number] = [self.run, self.used.len() as u32];
            self.used.push((vertex, material));
        }
        self.corners.push(*number);
    }

    /// The vertices' places and the corners of the triangles.
    fn triangles(&self, triangulator: &mut Triangulator) -> (Vec<DVec3>, Vec<u32>) {
        let place = |&(vertex, _): &(u32, u32)| at(self.places, vertex);
        let positions: Vec<DVec3> = self.used.iter().map(place).collect();
        let mut indices = Vec::with_capacity(self.corners.len());
        let mut rest = self.corners.as_slice();
        for &count in &self.faces {
            let face = rest.split_off(..count as usize).unwrap_or_default();
            triangulator.face(face, &positions, &mut indices);
        }
        (positions, indices)
    }
}

/// A vertex's own colour times its material's, as in glTF. Material libraries store colours in display form.
fn colour(tints: &Scale<'_>, vertex: u32, material: Option<&Material>) -> Rgba8 {
    let opacity = material.map_or(1.0, Material::opacity);
    let diffuse = material.and_then(|material| material.diffuse);
    let parts = match tints.of(vertex) {
        Some([r, g, b, a]) => {
            let [kr, kg, kb] = diffuse.unwrap_or([1.0; 3]);
            [r * kr, g * kg, b * kb, a * opacity]
        }
        None => {
            let [r, g, b] = diffuse.unwrap_or(GREY);
            [r, g, b, opacity]
        }
    };
    rgba(parts)
}

/// Undefined materials.
struct Undefined(BTreeMap<u32, Use>);

/// The use of an undefined material.
struct Use {
    name: String,
    count: u64,
    objects: Vec<String>,
}

impl Undefined {
    fn of(names: HashMap<u32, String>) -> Self {
        let unused = |(number, name)| (number, Use { name, count: 0, objects: Vec::new() });
        Self(names.into_iter().map(unused).collect())
    }

    fn used(&mut self, material: u32, object: &str) {
        let Some(of) = self.0.get_mut(&material) else { return };
        if of.objects.last().is_some_and(|last| last == object) {
            return;
        }
        of.count += 1;
        if of.objects.len() < Warning::OBJECTS {
            of.objects.push(object.to_owned());
        }
    }

    fn report(self, report: &mut ImportReport) {
        let mut used = self.0.into_values().filter(|of| of.count > 0);
        for Use { name, count, objects } in used.by_ref().take(MOST_NAMED) {
            report.warn_first(WarningKind::MaterialUndefined, &format!("{name:?}"), &objects, count);
        }
        let further = used.map(|of| of.count).sum();
        report.warn_about(WarningKind::MaterialUndefined, "further ones", further);
    }
}
