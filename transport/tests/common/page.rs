//! Captures the log for tests.

use std::io::{self, Write};
use std::sync::{Arc, Mutex};

use tracing::subscriber::DefaultGuard;

/// A writer for the log.
#[derive(Clone, Default)]
pub(crate) struct Page(Arc<Mutex<Vec<u8>>>);

impl Write for Page {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Page {
    /// Captures this thread's log while the guard lives.
    pub(crate) fn log() -> (Self, DefaultGuard) {
        let page = Self::default();
        let writer = page.clone();
        let subscriber =
            tracing_subscriber::fmt().with_ansi(false).with_writer(move || writer.clone()).finish();
        (page, tracing::subscriber::set_default(subscriber))
    }

    /// How many lines contain all of `words`.
    pub(crate) fn lines(&self, words: &[&str]) -> usize {
        let page = String::from_utf8(self.0.lock().unwrap().clone()).unwrap();
        page.lines().filter(|line| words.iter().all(|word| line.contains(word))).count()
    }
}
