//! A BCF file as notes.

use super::{
    super::{
        Frame, Note, NotesError, NotesFolder, SceneParts, Snapshot, SnapshotKind, View,
        folder::LONGEST_PICTURE,
    },
    BcfError, BcfVersion,
    archive::Archive,
    markup::{self, Viewpoint},
    viewpoint,
    xml::Element,
};

/// The content of a BCF file.
#[derive(Debug, Default, PartialEq)]
pub struct Imported {
    /// Its topics, each with its pictures.
    pub notes: Vec<(Note, Vec<Snapshot>)>,
    /// The things in it that notes do not have: a line for each.
    pub left_out: Vec<String>,
}

impl Imported {
    /// Keeps the notes in a folder. One without a place gets the middle of the first part that it is about.
    /// Returns what is left out.
    ///
    /// # Errors
    /// When one cannot be kept. Those before it are.
    pub fn keep(self, folder: &NotesFolder, parts: &SceneParts) -> Result<Vec<String>, NotesError> {
        for (mut note, snapshots) in self.notes {
            note.point = note.views.iter().find_map(|view| parts.middle(&view.selected));
            folder.merge(note, &snapshots)?;
        }
        Ok(self.left_out)
    }
}

/// Reads a BCF file of version 2.1 or 3.0. Nothing of it is written to the disk, and a small hostile file
/// takes no more memory than a large one may.
///
/// # Errors
/// When it is none, damaged or hostile. The error says where.
pub fn import(bytes: &[u8], frame: &Frame) -> Result<Imported, BcfError> {
    let mut archive = Archive::open(bytes)?;
    let version = archive.xml("bcf.version")?;
    let version = version.attribute("VersionId").unwrap_or_default();
    version.trim().parse::<BcfVersion>().map_err(|_| BcfError::Version(version.to_owned()))?;
    let mut imported = Imported::default();
    for entry in archive.names() {
        // A topic is a folder.
        let Some(folder) = entry.strip_suffix("/markup.bcf").filter(|folder| !folder.contains('/')) else {
            continue;
        };
        let root = archive.xml(&entry)?;
        let (mut note, viewpoints, left_out) = markup::read(&root, &entry)?;
        if left_out > 0 {
            imported.left_out.push(format!("{:?}: {left_out} documents and snippets", note.title));
        }
        let mut snapshots = Vec::new();
        for one in viewpoints {
            let view = read_view(&mut archive, folder, &one, frame, &mut imported.left_out)?;
            let snapshot = read_snapshot(&mut archive, folder, &one, &mut imported.left_out)?;
            note.views.push(View { snapshot: snapshot.as_ref().map(|snapshot| snapshot.kind), ..view });
            snapshots.extend(snapshot);
        }
        if imported.notes.iter().any(|(other, _)| other.guid == note.guid) {
            return Err(BcfError::Twice(note.guid.to_string()));
        }
        note.check().map_err(|cause| BcfError::Note { entry: entry.clone(), cause })?;
        imported.notes.push((note, snapshots));
    }
    Ok(imported)
}

/// The view of a viewpoint. One that has only a picture is an empty view.
fn read_view(
    archive: &mut Archive<'_>,
    folder: &str,
    one: &Viewpoint,
    frame: &Frame,
    left_out: &mut Vec<String>,
) -> Result<View, BcfError> {
    let empty = || viewpoint::read(&Element::default(), folder, one.guid, frame);
    let Some(file) = &one.file else { return empty() };
    let entry = format!("{folder}/{file}");
    match archive.xml(&entry) {
        Ok(root) => viewpoint::read(&root, &entry, one.guid, frame),
        Err(BcfError::Missing(_)) => {
            left_out.push(format!("{entry:?}, which is not in the file"));
            empty()
        }
        Err(error) => Err(error),
    }
}

fn read_snapshot(
    archive: &mut Archive<'_>,
    folder: &str,
    one: &Viewpoint,
    left_out: &mut Vec<String>,
) -> Result<Option<Snapshot>, BcfError> {
    let Some(file) = &one.snapshot else { return Ok(None) };
    let entry = format!("{folder}/{file}");
    let bytes = archive.bytes(&entry, LONGEST_PICTURE)?;
    let picture = bytes.and_then(|bytes| Some((SnapshotKind::of(&bytes)?, bytes)));
    if picture.is_none() {
        left_out.push(format!("{entry:?}, which is no PNG or JPEG, or not in the file"));
    }
    Ok(picture.map(|(kind, bytes)| Snapshot { view: one.guid, kind, bytes }))
}
