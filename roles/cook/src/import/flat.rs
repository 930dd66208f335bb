//! Objects that draw nothing: each of their triangles has two corners in one place.

use trimaran_scene::ObjectAttributes;

use super::Part;
use super::hierarchy::{Branch, groups};
use super::report::WarningKind;
use crate::Mesh;

/// Leaves out the objects without a triangle of three different corners, and counts them: nothing of them
/// would be in the scene, so they would have no place there.
pub(super) fn leave_out(part: &mut Part) {
    let flat: Vec<bool> = part.model.meshes.iter().map(draws_nothing).collect();
    let is_flat = |mesh: u32| flat.get(mesh as usize).copied().unwrap_or(false);
    if !part.model.objects.iter().any(|object| is_flat(object.mesh)) {
        return;
    }
    let mut kept: Vec<u32> = Vec::new();
    for (number, object) in (0..).zip(&part.model.objects) {
        if is_flat(object.mesh) {
            part.report.warn_of(WarningKind::EmptyObject, "", &object.name);
        } else {
            kept.push(number);
        }
    }
    let mut next = 0..;
    let mut number = |&flat: &bool| if flat { u32::MAX } else { next.next().unwrap_or(u32::MAX) };
    let numbers: Vec<u32> = flat.iter().map(&mut number).collect();
    let mut index = 0..flat.len() as u32;
    part.model.meshes.retain(|_| index.next().is_some_and(|mesh| !is_flat(mesh)));
    part.model.objects.retain(|object| !is_flat(object.mesh));
    for object in &mut part.model.objects {
        object.mesh = numbers.get(object.mesh as usize).copied().unwrap_or(u32::MAX);
    }
    let hierarchy = &mut part.model.hierarchy;
    let branches = std::mem::take(&mut hierarchy.groups).into_iter().map(|group| Branch {
        name: group.name,
        parent: group.parent,
        leaves: group.objects,
        attributes: group.attributes,
    });
    hierarchy.groups = groups(branches.collect(), &kept);
    let attributes = std::mem::take(&mut hierarchy.attributes).into_iter().filter_map(|of| {
        let object = kept.binary_search(&of.object).ok()? as u32;
        Some(ObjectAttributes { object, ..of })
    });
    hierarchy.attributes = attributes.collect();
}

fn draws_nothing(mesh: &Mesh) -> bool {
    let at = |corner: u32| mesh.positions.get(corner as usize);
    let is_flat = |&[a, b, c]: &[u32; 3]| at(a) == at(b) || at(b) == at(c) || at(c) == at(a);
    mesh.indices.as_chunks::<3>().0.iter().all(is_flat)
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, Vec3};
    use trimaran_scene::{Attribute, Extent, Group, Rgba8};

    use super::*;
    use crate::import::report::ImportReport;
    use crate::{Model, Object};

    #[test]
    fn what_is_left_keeps_its_mesh_its_group_and_its_attributes() {
        let corners = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]].map(Vec3::from_array).to_vec();
        let mesh = |indices: &[u32]| Mesh {
            positions: corners.clone(),
            colours: vec![Rgba8([0; 4]); 3],
            indices: indices.to_vec(),
        };
        let object = |mesh, name: &str| Object {
            mesh,
            to_world: DAffine3::IDENTITY,
            name: name.to_owned(),
            source: 0,
            source_index: 0,
        };
        let group = |name: &str, parent, objects| Group {
            name: name.to_owned(),
            parent,
            objects,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        let said = |object| ObjectAttributes {
            object,
            attributes: vec![Attribute { name: "of".to_owned(), value: object.to_string() }],
        };
        let mut model = Model {
            meshes: vec![mesh(&[0, 1, 0]), mesh(&[0, 0, 1, 0, 1, 2]), mesh(&[]), mesh(&[2, 1, 0])],
            objects: vec![
                object(0, "rod"),
                object(3, "a"),
                object(2, "nothing"),
                object(1, "b"),
                object(3, "c"),
            ],
            ..Model::default()
        };
        model.hierarchy.groups = vec![
            group("file", None, 0..5),
            group("rods", Some(0), 0..1),
            group("rest", Some(0), 1..5),
            group("last", Some(2), 3..5),
        ];
        model.hierarchy.attributes = [0, 1, 4].map(said).to_vec();
        let mut part = Part { model, report: ImportReport::default() };
        leave_out(&mut part);
        let objects: Vec<_> = part.model.objects.iter().map(|object| (&*object.name, object.mesh)).collect();
        assert_eq!(objects, [("a", 1), ("b", 0), ("c", 1)]);
        assert_eq!(part.model.meshes.iter().map(Mesh::triangle_count).collect::<Vec<_>>(), [2, 1]);
        let hierarchy = &part.model.hierarchy;
        let groups: Vec<_> =
            hierarchy.groups.iter().map(|g| (&*g.name, g.parent, g.objects.clone())).collect();
        assert_eq!(groups, [("file", None, 0..3), ("rest", Some(0), 0..3), ("last", Some(1), 1..3)]);
        let said: Vec<_> =
            hierarchy.attributes.iter().map(|of| (of.object, &*of.attributes[0].value)).collect();
        assert_eq!(said, [(0, "1"), (2, "4")]);
        assert_eq!(part.report.warnings[0].objects, ["rod", "nothing"]);
    }
}
