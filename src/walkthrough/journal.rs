//! Writes records of a walk while it goes on, on a thread of its own.

use std::{
    io,
    sync::mpsc::{Receiver, SyncSender, sync_channel},
    thread::{self, JoinHandle},
};

use trimaran_cull::Image;

use super::{
    compose::{Composer, FrameRecord},
    error::ReportingError,
    resume::Keeper,
};
use crate::report::{PictureKind, Writer};

/// How many frames and pictures may wait to be written. Beyond that the walk waits for the disk.
const WAITING: usize = 16;

/// Writes frames and pictures into a report's folder as they come.
#[derive(Debug)]
pub struct Journal {
    entries: SyncSender<Entry>,
    thread: JoinHandle<(Writer, Result<(), ReportingError>)>,
}

/// A record of a walk.
#[derive(Debug)]
pub(super) enum Entry {
    Frame(Box<FrameRecord>),
    Note(String),
    Picture { frame: u32, picture: Image },
}

/// Nothing more can be written; [`Journal::finish`] says why.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("the report's folder takes no more")]
pub struct JournalStopped;

impl Journal {
    /// Begins to write into a folder that already has the walk's head. With a `keeper` the walk can be
    /// resumed.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(super) fn start(writer: Writer, composer: Composer, keeper: Option<Keeper>) -> io::Result<Self> {
        let (entries, coming) = sync_channel(WAITING);
        let thread = thread::Builder::new()
            .name("journal".to_owned())
            .spawn(move || write(writer, composer, keeper, &coming))?;
        Ok(Self { entries, thread })
    }

    /// Takes an entry, and waits if the queue is full.
    pub(super) fn note(&self, entry: Entry) -> Result<(), JournalStopped> {
        self.entries.send(entry).map_err(|_| JournalStopped)
    }

    /// Waits until all is written. Returns the folder, and the error that stopped writing, if any.
    #[must_use]
    pub fn finish(self) -> (Writer, Option<ReportingError>) {
        drop(self.entries);
        match self.thread.join() {
            Ok((writer, result)) => (writer, result.err()),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

fn write(
    mut writer: Writer,
    mut composer: Composer,
    mut keeper: Option<Keeper>,
    coming: &Receiver<Entry>,
) -> (Writer, Result<(), ReportingError>) {
    let mut one = |entry: Entry| -> Result<(), ReportingError> {
        match entry {
            Entry::Frame(record) => {
                let state = keeper.as_mut().map(|keeper| keeper.keep(&record));
                writer.frame(&composer.frame(&record), state.as_ref())?;
            }
            Entry::Note(note) => writer.note(&note)?,
            Entry::Picture { frame, picture } => {
                writer.picture(frame, PictureKind::Shown, &picture)?;
            }
        }
        Ok(())
    };
    let result = coming.iter().try_for_each(&mut one);
    (writer, result)
}
