//! The remains of a killed process's walk: the journal's whole lines.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;
use std::time::SystemTime;

use serde::de::DeserializeOwned;

/// The content of a journal: its first line, and the others.
#[derive(Debug)]
pub struct Left<H, L> {
    /// The description of the walk.
    pub head: H,
    /// The records, in order.
    pub lines: Vec<L>,
    /// When the last record was written.
    pub stopped: SystemTime,
    /// Its length without an incomplete last line, bytes.
    pub(super) len: u64,
}

/// Reads the journal at `path`; `None` if it is not a valid one, or does not exist.
pub(super) fn read<H: DeserializeOwned, L: DeserializeOwned>(path: &Path) -> io::Result<Option<Left<H, L>>> {
    let file = match File::open(path) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let stopped = file.metadata()?.modified()?;
    let (mut head, mut lines, mut len) = (None, Vec::new(), 0);
    for line in WholeLines(BufReader::new(file)) {
        let line = line?;
        len += line.len() as u64;
        if head.is_none() {
            let Ok(read) = serde_json::from_slice(&line) else { return Ok(None) };
            head = Some(read);
        } else {
            let Ok(read) = serde_json::from_slice(&line) else { return Ok(None) };
            lines.push(read);
        }
    }
    Ok(head.map(|head| Left { head, lines, stopped, len }))
}

/// Whether the journal at `path` has more than its first line.
pub(super) fn has_records(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| WholeLines(BufReader::new(file)).nth(1).is_some())
}

/// The lines of a file, up to one without a line break.
struct WholeLines<R>(R);

impl<R: BufRead> Iterator for WholeLines<R> {
    type Item = io::Result<Vec<u8>>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut line = Vec::new();
        match self.0.read_until(b'\n', &mut line) {
            Ok(_) if !line.ends_with(b"\n") => None,
            read => Some(read.map(|_| line)),
        }
    }
}
