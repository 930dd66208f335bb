//! `trimaran notes`: lists the notes on a scene, and exchanges them as BCF.

use std::{
    fs::{self, File},
    io::{self, Read as _},
    path::Path,
    sync::Arc,
};

use serde_json::json;
use trimaran::notes::{
    Frame, Note, NotesFolder, SceneParts, Status, View,
    bcf::{self, BcfVersion},
};
use trimaran_scene::Scene;

use super::{Failure, args::NotesArgs, log::SAID, output, plural, print_json, terminal::word};

/// The longest BCF file that is read.
const LONGEST: u64 = 1 << 30;

pub(super) fn run(args: &NotesArgs) -> Result<(), Failure> {
    let scene = Arc::new(Scene::open(&args.scene).map_err(Failure::bad_input)?);
    let folder = args.notes.clone().unwrap_or_else(|| NotesFolder::beside(&args.scene));
    let notes = NotesFolder::new(folder, true);
    let parts = || {
        let hierarchy = Arc::new(scene.hierarchy().map_err(Failure::bad_input)?);
        Ok::<_, Failure>(SceneParts::new(&scene, &hierarchy))
    };
    let frame = || Frame::of(&scene).map_err(Failure::bad_input);
    match (&args.export, &args.import) {
        (Some(to), _) => export(&notes, &parts()?, &frame()?, args.version, to),
        (_, Some(from)) => import(&notes, &parts()?, &frame()?, from, args.json),
        (None, None) => list(&notes, args.json),
    }
}

fn list(notes: &NotesFolder, as_json: bool) -> Result<(), Failure> {
    let held = notes.all().map_err(Failure::broken)?;
    if as_json {
        return print_json(&json!({ "notes": held.notes, "damaged": held.damaged }));
    }
    for note in &held.notes {
        let Note { title, author, date, status, replies, .. } = &**note;
        let status = match status {
            Status::Open => "open",
            Status::Closed => "closed",
        };
        let replies = plural(replies.len() as u64, "reply", "replies");
        println!("{date}  {status:<6}  {}: {} ({replies})", word(author), word(title));
    }
    for line in &held.damaged {
        tracing::warn!(target: SAID, "{line}");
    }
    Ok(())
}

fn export(
    notes: &NotesFolder,
    parts: &SceneParts,
    frame: &Frame,
    version: BcfVersion,
    to: &Path,
) -> Result<(), Failure> {
    output::check(to, &output::BCF, &[]).map_err(Failure::bad_input)?;
    let held = notes.all().map_err(Failure::broken)?;
    if let Some(line) = held.damaged.first() {
        return Err(Failure::bad_input(line.clone()));
    }
    let pictures = |note: &Note, view: &View| notes.snapshot(note.guid, view.guid, view.snapshot?).ok();
    let told = |refs: &[_]| parts.for_others(refs);
    let bytes = bcf::export(&held.notes, version, frame, &pictures, &told).map_err(Failure::broken)?;
    let unwritten = |cause: io::Error| Failure::broken(format!("cannot write {}: {cause}", to.display()));
    fs::write(to, &bytes).map_err(unwritten)?;
    let count = plural(held.notes.len() as u64, "note", "notes");
    tracing::info!(target: SAID, "{}: {count} as BCF {version}", to.display());
    Ok(())
}

fn import(
    notes: &NotesFolder,
    parts: &SceneParts,
    frame: &Frame,
    from: &Path,
    as_json: bool,
) -> Result<(), Failure> {
    let unread = |cause: io::Error| Failure::bad_input(format!("cannot read {}: {cause}", from.display()));
    let mut bytes = Vec::new();
    File::open(from).and_then(|file| file.take(LONGEST + 1).read_to_end(&mut bytes)).map_err(unread)?;
    if bytes.len() as u64 > LONGEST {
        return Err(unread(io::ErrorKind::FileTooLarge.into()));
    }
    let imported = bcf::import(&bytes, frame);
    let imported = imported.map_err(|error| {
        Failure::bad_input(format!("cannot read {}: {}", from.display(), trimaran_transport::causes(&error)))
    })?;
    let count = imported.notes.len();
    let left_out = imported.keep(notes, parts).map_err(Failure::broken)?;
    if as_json {
        return print_json(&json!({ "notes": count, "leftOut": left_out }));
    }
    for line in left_out {
        tracing::warn!(target: SAID, "left out: {line}");
    }
    let count = plural(count as u64, "note", "notes");
    tracing::info!(target: SAID, "{}: {count} in {}", from.display(), notes.path().display());
    Ok(())
}
