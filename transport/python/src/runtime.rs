//! The tasks behind all links of this process, and waits that a signal ends.

use std::pin::pin;
use std::process;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tokio::runtime::{Builder, Runtime};
use trimaran_transport::{Instant, Net, TokioNet, until};

use crate::errors::other;

/// How often a wait looks for signals such as Ctrl-C, and tells progress.
const TICK: Duration = Duration::from_millis(50);
/// The threads that drive sockets and timers. Most work is done by the threads that wait.
const THREADS: usize = 2;

/// Tasks, and the network.
pub(crate) struct Engine {
    runtime: Runtime,
    pub(crate) net: Arc<dyn Net>,
    process: u32,
}

/// The engine of this process. It starts with the first link.
pub(crate) fn engine() -> PyResult<&'static Engine> {
    static ENGINE: OnceLock<Engine> = OnceLock::new();
    let engine = match ENGINE.get() {
        Some(engine) => engine,
        None => {
            let started = start()?;
            ENGINE.get_or_init(|| started)
        }
    };
    // Its threads are the parent's.
    if engine.process != process::id() {
        return Err(other(
            "links do not work in a forked process: start it by multiprocessing's method \"spawn\"",
        ));
    }
    Ok(engine)
}

fn start() -> PyResult<Engine> {
    let mut builder = Builder::new_multi_thread();
    let runtime = builder.worker_threads(THREADS).thread_name("trimaran").enable_all().build()?;
    let guard = runtime.enter();
    let net = Arc::new(TokioNet::current().map_err(|e| other(&e.to_string()))?);
    drop(guard);
    Ok(Engine { runtime, net, process: process::id() })
}

impl Engine {
    /// The time at which a wait of `seconds` ends; none if it has no limit.
    pub(crate) fn by(&self, seconds: Option<f64>) -> PyResult<Option<Instant>> {
        let Some(seconds) = seconds else { return Ok(None) };
        if seconds.is_nan() || seconds < 0.0 {
            let text = format!("a timeout of {seconds} seconds: give 0 or more, or None for no limit");
            return Err(PyValueError::new_err(text));
        }
        Ok(Duration::try_from_secs_f64(seconds).ok().map(|time| self.net.now().after(time)))
    }

    /// Runs `future` to its end, while other threads of Python run. `None` if `by` came first. A signal's
    /// handler that raises ends the wait, and so does `tick`, which is called now and then.
    pub(crate) fn wait<T: Send>(
        &self,
        py: Python<'_>,
        by: Option<Instant>,
        future: impl Future<Output = T> + Send,
        mut tick: impl FnMut(Python<'_>) -> PyResult<()>,
    ) -> PyResult<Option<T>> {
        let mut future = pin!(future);
        loop {
            let next = self.net.now().after(TICK);
            let next = by.map_or(next, |by| by.min(next));
            let came = py.detach(|| self.runtime.block_on(until(&*self.net, next, future.as_mut())));
            if came.is_some() {
                return Ok(came);
            }
            py.check_signals()?;
            tick(py)?;
            if by.is_some_and(|by| by <= self.net.now()) {
                return Ok(None);
            }
        }
    }

    /// The same without a limit.
    pub(crate) fn run<T: Send>(&self, py: Python<'_>, future: impl Future<Output = T> + Send) -> PyResult<T> {
        let ended = self.wait(py, None, future, |_| Ok(()))?;
        ended.ok_or_else(|| other("a wait without a limit ended"))
    }
}
