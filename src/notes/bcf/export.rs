//! Notes as a BCF file.

use std::{collections::BTreeSet, sync::Arc};

use super::{
    super::{Frame, Note, PartRef, Snapshot, View},
    BcfError, BcfVersion,
    archive::Packing,
    markup::{self, Viewpoint},
    viewpoint,
    xml::Element,
};

/// A BCF file of these notes. `snapshot` gets the picture of a note's view, and parts are named as `told`
/// names them for other programs.
///
/// # Errors
/// When it cannot be written.
pub fn export(
    notes: &[Arc<Note>],
    version: BcfVersion,
    frame: &Frame,
    snapshot: &dyn Fn(&Note, &View) -> Option<Snapshot>,
    told: &dyn Fn(&[PartRef]) -> Vec<PartRef>,
) -> Result<Vec<u8>, BcfError> {
    let mut packing = Packing::new();
    packing.xml("bcf.version", &version_document(version))?;
    if version == BcfVersion::V3 {
        packing.xml("extensions.xml", &extensions(notes))?;
    }
    for note in notes {
        let folder = note.guid;
        let mut viewpoints = Vec::with_capacity(note.views.len());
        for (number, view) in note.views.iter().enumerate() {
            // Other programs expect these names, where there is one.
            let [document, picture] = match number {
                0 => ["viewpoint".to_owned(), "snapshot".to_owned()],
                _ => [view.guid.to_string(), view.guid.to_string()],
            };
            // 3.0 has no viewpoint without a camera.
            let has_document = view.camera.is_some() || version == BcfVersion::V2;
            let file = has_document.then(|| format!("{document}.bcfv"));
            if let Some(file) = &file {
                let root = viewpoint::write(view, version, frame, told);
                packing.xml(&format!("{folder}/{file}"), &root)?;
            }
            let snapshot = snapshot(note, view);
            let name = snapshot.as_ref().map(|snapshot| format!("{picture}.{}", snapshot.kind.ending()));
            if let (Some(name), Some(snapshot)) = (&name, snapshot) {
                packing.packed(&format!("{folder}/{name}"), &snapshot.bytes)?;
            }
            viewpoints.push(Viewpoint { guid: view.guid, file, snapshot: name });
        }
        packing.xml(&format!("{folder}/markup.bcf"), &markup::write(note, version, &viewpoints))?;
    }
    packing.end()
}

fn version_document(version: BcfVersion) -> Element {
    let mut root = Element::new("Version").with("VersionId", version.to_string());
    if version == BcfVersion::V2 {
        root.add(Element::leaf("DetailedVersion", version.to_string()));
    }
    root
}

/// The words that the topics use, which 3.0 lists.
fn extensions(notes: &[Arc<Note>]) -> Element {
    let mut root = Element::new("Extensions");
    let mut list = |around: &str, name: &str, words: BTreeSet<&str>| {
        let mut list = Element::new(around);
        let words = words.into_iter().filter(|word| !word.trim().is_empty());
        list.children = words.map(|word| Element::leaf(name, word)).collect();
        root.add(list);
    };
    let statuses = notes.iter().map(|note| markup::status(note));
    list("TopicTypes", "TopicType", notes.iter().map(|note| markup::kind(note)).collect());
    list("TopicStatuses", "TopicStatus", statuses.chain(["Open", "Closed"]).collect());
    list("Priorities", "Priority", notes.iter().filter_map(|note| note.topic.priority.as_deref()).collect());
    list(
        "TopicLabels",
        "TopicLabel",
        notes.iter().flat_map(|note| &note.topic.labels).map(|word| &**word).collect(),
    );
    let mut users: BTreeSet<&str> = BTreeSet::new();
    for note in notes {
        let replied = note.replies.iter().map(|reply| &*reply.author);
        let named =
            [&note.topic.modified_by, &note.topic.assigned_to].into_iter().filter_map(Option::as_deref);
        users.extend(replied.chain(named).chain([&*note.author]));
    }
    list("Users", "User", users);
    list("Stages", "Stage", notes.iter().filter_map(|note| note.topic.stage.as_deref()).collect());
    root
}
