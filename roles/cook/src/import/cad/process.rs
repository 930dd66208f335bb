//! Runs the converter: its lines as they come, and its end.

use std::io::{self, BufRead, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use super::{CadError, Engine};

/// The exit code for a file that cannot be read.
const REFUSED: i32 = 2;
/// The exit code where the memory does not suffice.
const NO_MEMORY: i32 = 3;
/// The exit codes where the engine cannot be loaded. They are the program's own, and those of the system's
/// loader and shell for a library or a program that is not there.
const NO_ENGINE: [i32; 3] = [4, 126, 127];
/// How much is kept of standard error, bytes.
const MOST_SAID: u64 = 1_000;

/// Runs a command to its end. It is ended if it prints no line for `timeout`. `memory` is its limit, for the
/// error.
pub(super) fn run(
    command: &mut Command,
    engine: Engine,
    timeout: Duration,
    memory: u64,
    mut line: impl FnMut(&str),
) -> Result<(), CadError> {
    let files = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let started = files.spawn();
    let program = command.get_program().into();
    let mut running = Running(started.map_err(|source| CadError::Start { program, engine, source })?);
    let (out, errors) = (running.0.stdout.take(), running.0.stderr.take());
    let (sender, lines) = mpsc::channel();
    let printed = thread::spawn(move || {
        let Some(mut out) = out.map(BufReader::new) else { return };
        let mut bytes = Vec::new();
        while out.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
            let line = String::from_utf8_lossy(&bytes).trim_ascii_end().to_owned();
            bytes.clear();
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    let said = thread::spawn(move || {
        let mut said = Vec::new();
        if let Some(mut errors) = errors {
            let _whole = errors.by_ref().take(MOST_SAID).read_to_end(&mut said);
            // It must not wait for a reader.
            let _rest = io::copy(&mut errors, &mut io::sink());
        }
        String::from_utf8_lossy(&said).trim().to_owned()
    });
    loop {
        match lines.recv_timeout(timeout) {
            Ok(text) => line(&text),
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => return Err(CadError::Hung { timeout }),
        }
    }
    let status = running.0.wait().map_err(CadError::Folder)?;
    let _printed = printed.join();
    let said = said.join().unwrap_or_default();
    outcome(engine, status, said, memory)
}

fn outcome(engine: Engine, status: ExitStatus, said: String, memory: u64) -> Result<(), CadError> {
    match status.code() {
        Some(0) => Ok(()),
        Some(REFUSED) => Err(CadError::Refused { said }),
        Some(NO_MEMORY) => Err(CadError::Memory { limit: memory }),
        Some(code) if NO_ENGINE.contains(&code) => Err(CadError::NoEngine { engine, said }),
        _ => Err(CadError::Crashed { engine, status: status.to_string() }),
    }
}

/// A process that does not outlive its import.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ended = self.0.kill();
        let _status = self.0.wait();
    }
}
