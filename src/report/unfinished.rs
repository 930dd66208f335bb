//! The folder in which a report is made: `unfinished`, within the folder that will hold the report.
//!
//! It is made before anything is recorded, so that a folder that cannot be written to is known at once.
//! Records go into it as they come. A killed process leaves it behind; the next one resumes from it, or moves
//! it aside.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use super::error::{ReportError, io_error};
use super::left;

const NAME: &str = "unfinished";
const JOURNAL: &str = "walk.jsonl";
/// The remains of a killed process, until there are newer ones.
const ASIDE: &str = "unfinished.before";
/// Room for a page with its pictures and for the settings of a run, bytes.
const ROOM: usize = 2 << 20;

/// The folder of an unfinished report. Removed on drop, unless something was recorded.
#[derive(Debug)]
pub(super) struct Unfinished {
    path: PathBuf,
    /// Room kept free for the report, so that a full disk leaves enough for it.
    reserve: Option<File>,
    /// The lock on the report's folder, if the file system has locks.
    _lock: Option<File>,
    recorded: bool,
}

impl Unfinished {
    /// Creates the folder `out` if need be, and this one within it. An earlier process's records stay.
    pub(super) fn open(out: &Path) -> Result<Self, ReportError> {
        fs::create_dir_all(out).map_err(io_error("creating the folder", out))?;
        let lock = lock(out)?;
        let path = out.join(NAME);
        let recorded = left::has_records(&path.join(JOURNAL));
        let mut unfinished = Self { path, reserve: None, _lock: lock, recorded };
        if !recorded {
            remove_folder(&unfinished.path)?;
        }
        unfinished.prepare()?;
        Ok(unfinished)
    }

    /// Moves an earlier process's records aside.
    pub(super) fn clear(&mut self) -> Result<(), ReportError> {
        if !self.recorded {
            return Ok(());
        }
        self.release();
        move_aside(&self.path)?;
        self.recorded = false;
        self.prepare()
    }

    /// Ensures that there is a folder for records, and room at least for the report so far.
    fn prepare(&mut self) -> Result<(), ReportError> {
        let begin = || {
            fs::create_dir_all(self.path.join("frames"))?;
            let recorded = fs::metadata(self.journal()).map_or(0, |journal| journal.len());
            let reserve = File::options().create(true).append(true).open(self.path.join("reserve"))?;
            // A killed process left its reserve as well.
            let kept = reserve.metadata()?.len();
            Ok((reserve, (ROOM as u64 + 4 * recorded).saturating_sub(kept)))
        };
        let failed = |cause| io_error("writing into the folder", &self.path)(cause);
        let (reserve, wanted) = begin().map_err(failed)?;
        self.reserve = Some(reserve);
        self.reserve(wanted as usize).map_err(io_error("writing into the folder", &self.path))
    }

    pub(super) fn journal(&self) -> PathBuf {
        self.path.join(JOURNAL)
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Marks that the folder now holds records worth keeping.
    pub(super) const fn recorded(&mut self) {
        self.recorded = true;
    }

    /// Reserves this many more bytes.
    pub(super) fn reserve(&mut self, bytes: usize) -> io::Result<()> {
        let Some(file) = &mut self.reserve else { return Ok(()) };
        const ZEROS: [u8; 4096] = [0; 4096];
        let mut left = bytes;
        while left > 0 {
            let some = ZEROS.get(..left).unwrap_or(&ZEROS);
            file.write_all(some)?;
            left -= some.len();
        }
        Ok(())
    }

    /// Frees the reserve for the report.
    pub(super) fn release(&mut self) {
        if self.reserve.take().is_some() {
            let _kept = fs::remove_file(self.path.join("reserve"));
        }
    }

    /// Removes the folder: the report is in its place.
    pub(super) fn discard(mut self) {
        self.recorded = false;
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        self.release();
        if !self.recorded {
            let _left = fs::remove_dir_all(&self.path);
        }
    }
}

/// Allows one walk at a time to write into a folder.
fn lock(out: &Path) -> Result<Option<File>, ReportError> {
    let folder = File::open(out).map_err(io_error("opening the folder", out))?;
    match folder.try_lock() {
        Ok(()) => Ok(Some(folder)),
        Err(TryLockError::WouldBlock) => Err(ReportError::Busy { path: out.to_owned() }),
        // A file system without locks, such as some network file systems.
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

fn move_aside(left: &Path) -> Result<(), ReportError> {
    let aside = left.with_file_name(ASIDE);
    remove_folder(&aside)?;
    fs::rename(left, &aside).map_err(io_error("moving aside", left))?;
    tracing::warn!("a walk before this one left no report; what it recorded is in {}", aside.display());
    Ok(())
}

/// Removes a folder, if it exists.
fn remove_folder(path: &Path) -> Result<(), ReportError> {
    match fs::remove_dir_all(path) {
        Err(cause) if cause.kind() != ErrorKind::NotFound => {
            Err(io_error("removing the folder", path)(cause))
        }
        _ => Ok(()),
    }
}
