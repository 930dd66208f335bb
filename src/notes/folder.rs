//! The folder of a scene's notes: a file for each note, and one for each picture.

use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsStr,
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    sync::Arc,
    time::SystemTime,
};

use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Guid, Note, NoteFault};

/// The most notes, the most bytes of one, of a picture, and of all files together.
const NOTES: usize = 5000;
const LONGEST: u64 = 2 << 20;
pub(super) const LONGEST_PICTURE: u64 = 8 << 20;
const MOST_BYTES: u64 = 1 << 30;
/// Processes that write take turns by it.
const LOCK: &str = ".lock";

/// The notes of a scene in their folder, `plant.notes` beside `plant.scene`.
///
/// Several processes may use it at once. Each file is replaced as a whole. One that cannot be read is named,
/// and never written over.
#[derive(Debug)]
pub struct NotesFolder {
    folder: PathBuf,
    may_write: bool,
    held: Mutex<Arc<Held>>,
}

/// The notes as they were read last.
#[derive(Debug, Default)]
pub struct Held {
    /// The notes, by when they were written.
    pub notes: Vec<Arc<Note>>,
    /// The files that are no notes, and why: a line for each.
    pub damaged: Vec<String>,
    /// The state of each file.
    files: BTreeMap<Guid, (State, Option<Arc<Note>>)>,
    bytes: u64,
}

/// The length of a file, and when it was written.
type State = (u64, Option<SystemTime>);

/// The kind of a view's picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SnapshotKind {
    /// PNG.
    Png,
    /// JPEG.
    Jpg,
}

/// The picture of a view.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Snapshot {
    /// The view.
    pub view: Guid,
    /// Its kind.
    pub kind: SnapshotKind,
    /// The file's bytes.
    pub bytes: Vec<u8>,
}

/// Why notes cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NotesError {
    /// The system does not let it.
    #[error("cannot use {path}", path = path.display())]
    Io {
        /// The file or the folder.
        path: PathBuf,
        /// Why.
        #[source]
        cause: io::Error,
    },
    /// A file is no note.
    #[error("{path} is damaged: mend it, or move it away", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A note breaks a limit.
    #[error("the note cannot be kept")]
    Note(#[from] NoteFault),
    /// There is no such note, or not any more.
    #[error("there is no such note any more")]
    Missing,
    /// Only others may do that.
    #[error("only the person who wrote a note can delete it")]
    Foreign,
    /// Notes are only shown.
    #[error("notes cannot be written here: they are only shown")]
    ReadOnly,
    /// There is no room for another one.
    #[error("there are too many notes: {NOTES} of them, or 1 GiB with their pictures, is the most")]
    Full,
}

impl SnapshotKind {
    /// The kind of a picture by its first bytes; `None` if it is another one.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let is = |magic: &[u8]| bytes.starts_with(magic);
        is(b"\x89PNG\r\n\x1a\n").then_some(Self::Png).or_else(|| is(b"\xff\xd8\xff").then_some(Self::Jpg))
    }

    /// The ending of a file's name.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpg => "jpg",
        }
    }

    /// The media type.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpg => "image/jpeg",
        }
    }
}

impl NotesFolder {
    /// The folder of the notes on a scene or model: its name with the ending `notes`.
    #[must_use]
    pub fn beside(file: &Path) -> PathBuf {
        file.with_extension("notes")
    }

    /// The notes in a folder. It is made with the first note.
    #[must_use]
    pub fn new(folder: PathBuf, may_write: bool) -> Self {
        Self { folder, may_write, held: Mutex::default() }
    }

    /// Whether notes can be written here at all.
    #[must_use]
    pub const fn may_write(&self) -> bool {
        self.may_write
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// All notes, with those that other processes have written.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn all(&self) -> Result<Arc<Held>, NotesError> {
        let mut held = self.held.lock();
        *held = Arc::new(self.read(&held)?);
        Ok(Arc::clone(&held))
    }

    /// A note.
    ///
    /// # Errors
    /// When there is none, or the folder cannot be read.
    pub fn get(&self, guid: Guid) -> Result<Arc<Note>, NotesError> {
        let held = self.all()?;
        let note = held.files.get(&guid).and_then(|(_, note)| note.clone());
        note.ok_or(NotesError::Missing)
    }

    /// The picture of a note's view.
    ///
    /// # Errors
    /// When there is none, or it cannot be read.
    pub fn snapshot(&self, note: Guid, view: Guid, kind: SnapshotKind) -> Result<Snapshot, NotesError> {
        let path = self.picture(note, view, kind);
        let bytes = read_at_most(&path, LONGEST_PICTURE);
        let bytes = bytes.map_err(|cause| NotesError::Io { path, cause })?;
        Ok(Snapshot { view, kind, bytes })
    }

    /// Adds a note with its pictures.
    ///
    /// # Errors
    /// When it breaks a limit, is there already, or cannot be written.
    pub fn add(&self, note: &Note, snapshots: &[Snapshot]) -> Result<(), NotesError> {
        self.write(note.guid, snapshots, |there| match there {
            None => Ok(note.clone()),
            Some(_) => {
                Err(NotesError::Io { path: self.file(note.guid), cause: io::ErrorKind::AlreadyExists.into() })
            }
        })
    }

    /// Changes a note.
    ///
    /// # Errors
    /// When it is gone, the change breaks a limit, or it cannot be written.
    pub fn change(&self, guid: Guid, change: impl FnOnce(&mut Note)) -> Result<(), NotesError> {
        self.write(guid, &[], |there| {
            let mut note = there.ok_or(NotesError::Missing)?;
            change(&mut note);
            Ok(note)
        })
    }

    /// Adds a note of another tool. If it is there already, its texts and views become those of this one.
    /// Replies and views that only one of both has stay, and so do its place and its owner.
    ///
    /// # Errors
    /// When it breaks a limit, or cannot be written.
    pub fn merge(&self, note: Note, snapshots: &[Snapshot]) -> Result<(), NotesError> {
        self.write(note.guid, snapshots, |there| {
            let Some(there) = there else { return Ok(note) };
            let Note { mut views, mut replies, .. } = note;
            let known: BTreeSet<Guid> = views.iter().map(|view| view.guid).collect();
            views.extend(there.views.into_iter().filter(|view| !known.contains(&view.guid)));
            let known: BTreeSet<Guid> = replies.iter().map(|reply| reply.guid).collect();
            replies.extend(there.replies.into_iter().filter(|reply| !known.contains(&reply.guid)));
            let (point, owner) = (there.point.or(note.point), there.owner);
            Ok(Note { views, replies, point, owner, ..note })
        })
    }

    /// Deletes a note with its pictures, if `may` says so.
    ///
    /// # Errors
    /// When it is gone, somebody else's, or cannot be deleted.
    pub fn delete(&self, guid: Guid, may: impl FnOnce(&Note) -> bool) -> Result<(), NotesError> {
        let _turn = self.turn()?;
        let path = self.file(guid);
        let note = self.read_note(guid)?.ok_or(NotesError::Missing)?;
        if !may(&note) {
            return Err(NotesError::Foreign);
        }
        fs::remove_file(&path).map_err(|cause| NotesError::Io { path, cause })?;
        for view in &note.views {
            // Without its note nobody asks for it.
            let _gone = view.snapshot.map(|kind| fs::remove_file(self.picture(guid, view.guid, kind)));
        }
        Ok(())
    }

    fn write(
        &self,
        guid: Guid,
        snapshots: &[Snapshot],
        make: impl FnOnce(Option<Note>) -> Result<Note, NotesError>,
    ) -> Result<(), NotesError> {
        let _turn = self.turn()?;
        let held = self.all()?;
        let note = make(self.read_note(guid)?)?;
        note.check()?;
        let json = serde_json::to_vec_pretty(&note).map_err(|cause| self.io(cause.into()))?;
        let added = json.len() as u64 + snapshots.iter().map(|one| one.bytes.len() as u64).sum::<u64>();
        let is_new = !held.files.contains_key(&guid);
        if held.bytes + added > MOST_BYTES || (is_new && held.files.len() >= NOTES) {
            return Err(NotesError::Full);
        }
        if json.len() as u64 > LONGEST {
            return Err(NoteFault::Long("the note", LONGEST as usize).into());
        }
        for Snapshot { view, kind, bytes } in snapshots {
            self.replace(&self.picture(guid, *view, *kind), bytes)?;
        }
        self.replace(&self.file(guid), &json)
    }

    /// Waits until no other process writes here.
    fn turn(&self) -> Result<File, NotesError> {
        if !self.may_write {
            return Err(NotesError::ReadOnly);
        }
        fs::create_dir_all(&self.folder).map_err(|cause| self.io(cause))?;
        let path = self.folder.join(LOCK);
        let lock = File::options().create(true).truncate(false).write(true).open(&path);
        let locked = lock.and_then(|lock| lock.lock().map(|()| lock));
        locked.map_err(|cause| NotesError::Io { path, cause })
    }

    fn replace(&self, path: &Path, bytes: &[u8]) -> Result<(), NotesError> {
        let written = || {
            let mut builder = tempfile::Builder::new();
            #[cfg(unix)]
            let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o666); // less the umask
            #[cfg(unix)]
            builder.permissions(permissions);
            let mut file = builder.prefix(".trimaran-").suffix(".tmp").tempfile_in(&self.folder)?;
            file.write_all(bytes)?;
            file.as_file().sync_all()?;
            file.persist(path)?;
            File::open(&self.folder)?.sync_all()
        };
        written().map_err(|cause| NotesError::Io { path: path.to_owned(), cause })
    }

    /// Reads what has changed since.
    fn read(&self, before: &Held) -> Result<Held, NotesError> {
        let mut held = Held::default();
        let entries = match fs::read_dir(&self.folder) {
            Ok(entries) => entries,
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(held),
            Err(cause) => return Err(self.io(cause)),
        };
        for entry in entries {
            let entry = entry.map_err(|cause| self.io(cause))?;
            let path = entry.path();
            // Another process may remove it meanwhile.
            let Ok(metadata) = entry.metadata() else { continue };
            held.bytes += metadata.len();
            let guid = path.file_stem().and_then(OsStr::to_str).and_then(|stem| stem.parse::<Guid>().ok());
            let Some(guid) = guid.filter(|_| path.extension() == Some(OsStr::new("json"))) else { continue };
            let state = (metadata.len(), metadata.modified().ok());
            let known = before.files.get(&guid).filter(|(known, note)| *known == state && note.is_some());
            let note = match known {
                Some((_, note)) => note.clone(),
                None => match self.read_note(guid) {
                    Ok(note) => note.map(Arc::new),
                    Err(error) => {
                        held.damaged.push(trimaran_transport::causes(&error));
                        None
                    }
                },
            };
            held.files.insert(guid, (state, note));
        }
        held.notes = held.files.values().filter_map(|(_, note)| note.clone()).collect();
        held.notes.sort_by(|a, b| a.date.as_str().cmp(b.date.as_str()));
        held.damaged.sort();
        for line in held.damaged.iter().filter(|line| !before.damaged.contains(line)) {
            tracing::warn!("{line}");
        }
        Ok(held)
    }

    /// The note in its file; `None` if there is no file.
    fn read_note(&self, guid: Guid) -> Result<Option<Note>, NotesError> {
        let path = self.file(guid);
        let damaged = |cause| NotesError::Damaged { path: path.clone(), cause };
        let bytes = match read_at_most(&path, LONGEST) {
            Ok(bytes) => bytes,
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(cause) if cause.kind() == io::ErrorKind::FileTooLarge => return Err(damaged(cause.into())),
            Err(cause) => return Err(NotesError::Io { path, cause }),
        };
        let note: Note = serde_json::from_slice(&bytes).map_err(|cause| damaged(cause.into()))?;
        note.check().map_err(|cause| damaged(cause.into()))?;
        if note.guid != guid {
            return Err(damaged(format!("it has the note {}", note.guid).into()));
        }
        Ok(Some(note))
    }

    fn file(&self, note: Guid) -> PathBuf {
        self.folder.join(format!("{note}.json"))
    }

    fn picture(&self, note: Guid, view: Guid, kind: SnapshotKind) -> PathBuf {
        self.folder.join(format!("{note}.{view}.{}", kind.ending()))
    }

    fn io(&self, cause: io::Error) -> NotesError {
        NotesError::Io { path: self.folder.clone(), cause }
    }
}

/// The bytes of a file that is no longer than this.
pub(super) fn read_at_most(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { Err(io::ErrorKind::FileTooLarge.into()) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{Reply, Status, guid::tests::guid, note::tests::full},
        *,
    };

    fn folder() -> (tempfile::TempDir, NotesFolder) {
        let place = tempfile::tempdir().unwrap();
        let notes = NotesFolder::new(NotesFolder::beside(&place.path().join("plant.v2.scene")), true);
        (place, notes)
    }

    fn guids(notes: &NotesFolder) -> Vec<Guid> {
        notes.all().unwrap().notes.iter().map(|note| note.guid).collect()
    }

    fn names(notes: &NotesFolder) -> Vec<String> {
        let entries = fs::read_dir(notes.path()).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_folder_is_made_with_the_first_note_and_lies_beside_the_scene() {
        let (place, notes) = folder();
        assert_eq!(notes.path(), place.path().join("plant.v2.notes"));
        assert!(notes.all().unwrap().notes.is_empty());
        assert!(matches!(notes.get(guid(1)), Err(NotesError::Missing)));
        assert!(!notes.path().exists());
        notes.add(&full(1), &[]).unwrap();
        assert_eq!(*notes.get(guid(1)).unwrap(), full(1));
        assert!(matches!(notes.add(&full(1), &[]), Err(NotesError::Io { .. })), "a second one");
    }

    /// Two processes have a folder each.
    #[test]
    fn what_one_writes_the_other_sees_and_nothing_is_lost() {
        let (_place, one) = folder();
        let other = NotesFolder::new(one.path().to_owned(), true);
        one.add(&full(1), &[]).unwrap();
        assert_eq!(guids(&other), [guid(1)]);
        other.add(&Note { date: "2020-01-01T00:00:00Z".parse().unwrap(), ..full(9) }, &[]).unwrap();
        assert_eq!(guids(&one), [guid(9), guid(1)], "the oldest first");
        let reply = |number: u128| Reply { guid: guid(number), ..full(1).replies[0].clone() };
        one.change(guid(1), |note| note.replies.push(reply(100))).unwrap();
        other.change(guid(1), |note| note.replies.push(reply(101))).unwrap();
        one.change(guid(1), |note| note.status = Status::Closed).unwrap();
        for notes in [&one, &other] {
            let note = notes.get(guid(1)).unwrap();
            let replies: Vec<_> = note.replies.iter().map(|reply| reply.guid).collect();
            assert_eq!((replies, note.status), (vec![guid(3), guid(100), guid(101)], Status::Closed));
        }
        other.delete(guid(1), |_| true).unwrap();
        assert_eq!(guids(&one), [guid(9)]);
        assert!(matches!(one.change(guid(1), |_| ()), Err(NotesError::Missing)));
        assert!(matches!(one.delete(guid(9), |_| false), Err(NotesError::Foreign)));
        assert_eq!(names(&one).len(), 2, "the other note and the lock: {:?}", names(&one));
    }

    #[test]
    fn many_write_at_once() {
        let (_place, notes) = folder();
        notes.add(&full(1), &[]).unwrap();
        std::thread::scope(|scope| {
            for writer in 0..4_u128 {
                let notes = NotesFolder::new(notes.path().to_owned(), true);
                scope.spawn(move || {
                    for number in 0..8_u128 {
                        let reply =
                            Reply { guid: guid(1000 * (writer + 1) + number), ..full(1).replies[0].clone() };
                        notes.change(guid(1), |note| note.replies.push(reply)).unwrap();
                    }
                });
            }
        });
        assert_eq!(notes.get(guid(1)).unwrap().replies.len(), 1 + 4 * 8);
    }

    #[test]
    fn a_damaged_file_is_named_and_stays_as_it_is() {
        let (_place, notes) = folder();
        for number in [1, 10, 20] {
            notes.add(&full(number), &[]).unwrap();
        }
        let whole = fs::read(notes.file(guid(1))).unwrap();
        let other = serde_json::to_vec(&full(2)).unwrap();
        let mut odd = full(1);
        odd.author.clear();
        let long = vec![b' '; LONGEST as usize + 1];
        let cut = whole.get(..100).unwrap();
        for damaged in [&b""[..], b"{}", b"\xff\xfe", cut, &other, &serde_json::to_vec(&odd).unwrap(), &long]
        {
            let path = notes.file(guid(1));
            fs::write(&path, damaged).unwrap();
            let held = notes.all().unwrap();
            assert_eq!(guids(&notes), [guid(10), guid(20)], "the others are shown");
            assert_eq!(held.damaged.len(), 1);
            assert!(held.damaged[0].contains(&*path.to_string_lossy()), "{:?}", held.damaged);
            for result in [
                notes.add(&full(1), &[]),
                notes.merge(full(1), &[]),
                notes.change(guid(1), |note| note.status = Status::Closed),
                notes.delete(guid(1), |_| true),
            ] {
                assert!(matches!(result, Err(NotesError::Damaged { .. })), "{result:?}");
            }
            assert_eq!(fs::read(&path).unwrap(), damaged);
        }
        fs::write(notes.file(guid(1)), whole).unwrap();
        assert_eq!((guids(&notes).len(), notes.all().unwrap().damaged.len()), (3, 0), "it was mended");
    }

    #[test]
    fn a_folder_that_is_only_shown_is_never_written() {
        let (_place, notes) = folder();
        notes.add(&full(1), &[]).unwrap();
        let before = names(&notes);
        let shown = NotesFolder::new(notes.path().to_owned(), false);
        for result in [
            shown.add(&full(10), &[]),
            shown.merge(full(10), &[]),
            shown.change(guid(1), |note| note.status = Status::Closed),
            shown.delete(guid(1), |_| true),
        ] {
            assert!(matches!(result, Err(NotesError::ReadOnly)), "{result:?}");
        }
        assert_eq!((names(&notes), &*shown.get(guid(1)).unwrap()), (before, &full(1)));
    }

    #[test]
    fn a_note_beyond_a_limit_is_not_kept() {
        let (_place, notes) = folder();
        assert!(matches!(
            notes.add(&Note { title: String::new(), ..full(1) }, &[]),
            Err(NotesError::Note(_))
        ));
        notes.add(&full(1), &[]).unwrap();
        let fill = |note: &mut Note| {
            let long = Reply { text: "x".repeat(60_000), ..note.replies[0].clone() };
            note.replies.extend(vec![long; 40]);
        };
        assert!(matches!(notes.change(guid(1), fill), Err(NotesError::Note(NoteFault::Long(..)))));
        assert_eq!(*notes.get(guid(1)).unwrap(), full(1));
    }

    #[test]
    fn a_picture_comes_and_goes_with_its_note() {
        let (_place, notes) = folder();
        let mut note = full(1);
        note.views[0].snapshot = Some(SnapshotKind::Png);
        let bytes = b"\x89PNG\r\n\x1a\n and more".to_vec();
        let snapshot = Snapshot { view: guid(2), kind: SnapshotKind::of(&bytes).unwrap(), bytes };
        notes.add(&note, std::slice::from_ref(&snapshot)).unwrap();
        assert_eq!(notes.snapshot(guid(1), guid(2), SnapshotKind::Png).unwrap(), snapshot);
        assert!(notes.snapshot(guid(1), guid(2), SnapshotKind::Jpg).is_err());
        assert!(notes.snapshot(guid(9), guid(2), SnapshotKind::Png).is_err(), "that of another note");
        notes.delete(guid(1), |_| true).unwrap();
        assert_eq!(names(&notes), [LOCK]);
        assert_eq!(SnapshotKind::of(b"\xff\xd8\xff\xe0"), Some(SnapshotKind::Jpg));
        assert_eq!(SnapshotKind::of(b"<svg"), None);
    }

    #[test]
    fn a_note_that_comes_again_keeps_the_replies_of_both() {
        let (_place, notes) = folder();
        notes.add(&full(1), &[]).unwrap();
        notes
            .change(guid(1), |note| note.replies.push(Reply { guid: guid(50), ..note.replies[0].clone() }))
            .unwrap();
        let mut again = Note { title: "Other".to_owned(), point: None, owner: None, ..full(1) };
        again.replies.push(Reply { guid: guid(60), ..again.replies[0].clone() });
        notes.merge(again.clone(), &[]).unwrap();
        let merged = notes.get(guid(1)).unwrap();
        let replies: Vec<_> = merged.replies.iter().map(|reply| reply.guid).collect();
        assert_eq!(replies, [guid(3), guid(60), guid(50)]);
        assert_eq!((&*merged.title, merged.point, &merged.owner), ("Other", full(1).point, &full(1).owner));
        notes.merge(Note { guid: guid(99), ..again }, &[]).unwrap();
        assert_eq!(guids(&notes).len(), 2);
    }
}
