//! Listening for peers.

use std::time::Duration;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tokio::sync::{Mutex, watch};
use trimaran_transport::untyped::Untyped;
use trimaran_transport::{Endpoint, Endpoints, Instant, until};

use crate::errors;
use crate::link::Link;
use crate::runtime::engine;
use crate::setup::Setup;

/// How long a close waits for the addresses. Links over quic and udp keep theirs for longer.
const FREED: Duration = Duration::from_secs(1);

/// Accepts peers.
#[pyclass(frozen, module = "trimaran_transport._native")]
pub(crate) struct Listener {
    listener: Mutex<Option<trimaran_transport::Listener<Untyped>>>,
    closing: watch::Sender<bool>,
    setup: Py<Setup>,
    #[pyo3(get)]
    endpoints: Vec<String>,
}

/// Listens at all of `endpoints`.
#[pyfunction]
pub(crate) fn listen(py: Python<'_>, endpoints: Vec<String>, setup: Py<Setup>) -> PyResult<Listener> {
    let engine = engine()?;
    let parsed: Result<Vec<Endpoint>, _> = endpoints.iter().map(|text| text.parse()).collect();
    let mut parsed = parsed.map_err(|e| errors::mistake(&e))?.into_iter();
    let first = parsed.next().ok_or_else(|| PyValueError::new_err("no endpoint is given to listen at"))?;
    let endpoints = parsed.fold(Endpoints::from(first), Endpoints::and);
    let Setup { hello, options, .. } = setup.get();
    let bound = trimaran_transport::Listener::bind_all(&engine.net, &endpoints, hello.clone(), options);
    let listener = engine.run(py, bound)?.map_err(|e| errors::listening(&e))?;
    let endpoints = listener.local_endpoints().iter().map(ToString::to_string).collect();
    Ok(Listener {
        listener: Mutex::new(Some(listener)),
        closing: watch::Sender::new(false),
        setup,
        endpoints,
    })
}

#[pymethods]
impl Listener {
    /// The next peer's link.
    fn accept(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<Link> {
        let engine = engine()?;
        let by = engine.by(timeout)?.unwrap_or(Instant::from_nanos(u64::MAX));
        let mut closing = self.closing.subscribe();
        let accepted = engine.run(py, async {
            tokio::select! {
                biased;
                accepted = async {
                    match &mut *self.listener.lock().await {
                        Some(listener) => Some(listener.accept(by).await),
                        None => None,
                    }
                } => accepted,
                _ = closing.wait_for(|closing| *closing) => None,
            }
        })?;
        let link = accepted.ok_or_else(|| errors::other("the listener is closed"))?;
        Link::begin(py, link.map_err(|e| errors::accepting(&e))?, self.setup.clone_ref(py))
    }

    /// Stops listening.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let engine = engine()?;
        self.closing.send_replace(true);
        engine.run(py, async {
            if let Some(listener) = self.listener.lock().await.take() {
                let _freed = until(&*engine.net, engine.net.now().after(FREED), listener.close()).await;
            }
        })
    }
}
