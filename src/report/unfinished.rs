//! The folder in which a report comes to be: `unfinished`, within the folder that will hold the report.
//!
//! It is there before anything is recorded, so that a folder that cannot be written to is known at once. What
//! is recorded goes into it as it comes. A process that is killed leaves it behind; the next one moves it
//! aside.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use super::error::{ReportError, io_error};

const NAME: &str = "unfinished";
/// What a process that was killed left behind, until the next one does.
const ASIDE: &str = "unfinished.before";
/// Room for a page with its pictures and for the settings of a run, bytes.
const ROOM: usize = 2 << 20;

/// The folder of a report that is not finished. Dropped, it is removed, unless something was recorded.
#[derive(Debug)]
pub(super) struct Unfinished {
    path: PathBuf,
    /// Room kept free for the report, so that a full disk leaves enough for it.
    reserve: Option<File>,
    /// The lock on the report's folder, where the file system has locks.
    _lock: Option<File>,
    recorded: bool,
}

impl Unfinished {
    /// Creates the folder `out` if need be, and this one within it.
    pub(super) fn create(out: &Path) -> Result<Self, ReportError> {
        fs::create_dir_all(out).map_err(io_error("creating the folder", out))?;
        let lock = lock(out)?;
        let path = out.join(NAME);
        move_aside(&path, &out.join(ASIDE))?;
        let frames = path.join("frames");
        fs::create_dir_all(&frames).map_err(io_error("writing into the folder", out))?;
        let mut unfinished = Self { path, reserve: None, _lock: lock, recorded: false };
        let reserve = unfinished.path.join("reserve");
        unfinished.reserve = Some(File::create(&reserve).map_err(io_error("writing into the folder", out))?);
        unfinished.reserve(ROOM).map_err(io_error("writing into the folder", out))?;
        Ok(unfinished)
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// From now on there is something worth keeping here.
    pub(super) const fn recorded(&mut self) {
        self.recorded = true;
    }

    /// Keeps room for so many bytes more.
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

    /// Gives the room that was kept free to what is written now: the report.
    pub(super) fn release(&mut self) {
        if self.reserve.take().is_some() {
            let _kept = fs::remove_file(self.path.join("reserve"));
        }
    }

    /// The report is in its place: nothing here is needed any more.
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

/// One walk at a time writes into a folder.
fn lock(out: &Path) -> Result<Option<File>, ReportError> {
    let folder = File::open(out).map_err(io_error("opening the folder", out))?;
    match folder.try_lock() {
        Ok(()) => Ok(Some(folder)),
        Err(TryLockError::WouldBlock) => Err(ReportError::Busy { path: out.to_owned() }),
        // A file system without locks, such as some of those over a network.
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

fn move_aside(left: &Path, aside: &Path) -> Result<(), ReportError> {
    if !left.try_exists().map_err(io_error("reading", left))? {
        return Ok(());
    }
    match fs::remove_dir_all(aside) {
        Err(cause) if cause.kind() != ErrorKind::NotFound => {
            return Err(io_error("removing the older folder", aside)(cause));
        }
        _ => {}
    }
    fs::rename(left, aside).map_err(io_error("moving aside", left))?;
    tracing::warn!("a walk before this one left no report; what it recorded is in {}", aside.display());
    Ok(())
}
