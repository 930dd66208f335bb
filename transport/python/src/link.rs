//! A link, whose halves any thread may use.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytes::Bytes;
use parking_lot::Mutex as Lock;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyByteArray, PyBytes};
use tokio::sync::oneshot;
use trimaran_transport::untyped::{Raw, RawValue, Untyped};
use trimaran_transport::{
    BlobError, BlobEvent, BlobReceiver, CloseReason, ConnectError, Endpoint, Instant, KeepLast, PeerInfo,
    StatsHandle, WholeFrame, connect as connected,
};

use crate::errors;
use crate::halves::{self, Closing, Halves, send};
use crate::runtime::engine;
use crate::setup::Setup;

/// A link of bytes.
#[pyclass(frozen, module = "trimaran_transport._native")]
pub(crate) struct Link {
    pub(crate) halves: Arc<Halves>,
    peer: PeerInfo<Untyped>,
    stats: StatsHandle,
    capabilities: [bool; 4],
    close: Lock<Option<oneshot::Sender<Closing>>>,
    setup: Py<Setup>,
}

/// A frame: number, header, items, age in seconds, and the counts of skipped frames.
type Frame<'py> = (u32, Bound<'py, PyBytes>, Bound<'py, PyByteArray>, f64, (u64, u64, u64));

/// Connects to a listener, until the timeout.
#[pyfunction]
pub(crate) fn connect(py: Python<'_>, endpoint: &str, setup: Py<Setup>, timeout: f64) -> PyResult<Link> {
    let engine = engine()?;
    let endpoint: Endpoint = endpoint.parse().map_err(|e| errors::mistake(&e))?;
    let by = engine.by(Some(timeout))?.unwrap_or(Instant::from_nanos(u64::MAX));
    let Setup { hello, options, .. } = setup.get();
    let link = connected::<Untyped>(&engine.net, &endpoint, hello.clone(), options, by);
    let link = engine.run(py, link)?.map_err(|e: ConnectError| errors::connecting(&e))?;
    Link::begin(py, link, setup)
}

impl Link {
    /// Spreads the halves of a link.
    pub(crate) fn begin(
        py: Python<'_>,
        link: trimaran_transport::Link<Untyped>,
        setup: Py<Setup>,
    ) -> PyResult<Self> {
        let engine = engine()?;
        let (peer, stats) = (link.peer.clone(), link.stats.clone());
        let can = link.capabilities();
        let capabilities = [can.reliable, can.ordered, can.encrypted, can.local];
        let (close, asked) = oneshot::channel();
        let (spread, halves) = oneshot::channel();
        engine.net.spawn(Box::pin(halves::keep(link, setup.get().max_blob, spread, asked)));
        let halves = engine.run(py, halves)?.map_err(|_| errors::other("the link's task is gone"))?;
        Ok(Self { halves, peer, stats, capabilities, close: Lock::new(Some(close)), setup })
    }

    /// Uses a half until `by`, or until this side closes the link.
    fn using<R: Send>(
        &self,
        py: Python<'_>,
        by: Option<Instant>,
        work: impl Future<Output = Option<R>> + Send,
        tick: impl FnMut(Python<'_>) -> PyResult<()>,
    ) -> PyResult<R> {
        let ended = engine()?.wait(py, by, self.halves.until_closed(work), tick)?;
        ended.ok_or_else(|| errors::late(&self.peer.name))?.ok_or_else(errors::closed_here)
    }
}

#[pymethods]
impl Link {
    /// The name, the hello, the address and the transport of the peer.
    #[getter]
    fn peer<'py>(&self, py: Python<'py>) -> (String, Bound<'py, PyBytes>, String, &'static str) {
        let PeerInfo { name, hello, address, .. } = &self.peer;
        (name.to_string(), PyBytes::new(py, &hello.bytes), address.to_string(), address.transport())
    }

    /// Reliable, ordered, encrypted, local.
    #[getter]
    const fn capabilities(&self) -> (bool, bool, bool, bool) {
        let [reliable, ordered, encrypted, local] = self.capabilities;
        (reliable, ordered, encrypted, local)
    }

    /// Sent bytes, received bytes, and the counts of skipped frames.
    fn stats(&self) -> (u64, u64, (u64, u64, u64)) {
        let stats = self.stats.read();
        let skipped = stats.skipped;
        let skipped = (skipped.replaced, skipped.expired, skipped.incomplete);
        (stats.sent.total_bytes(), stats.received.total_bytes(), skipped)
    }

    fn publish(&self, py: Python<'_>, value: &[u8]) -> PyResult<()> {
        let value = RawValue::from(value);
        let work = async { Some(self.halves.latest_tx.lock().await.as_mut()?.publish(value)) };
        self.using(py, None, work, none)?.map_err(|e| errors::sending(&e))
    }

    fn latest<'py>(&self, py: Python<'py>, timeout: Option<f64>) -> PyResult<Bound<'py, PyBytes>> {
        let by = engine()?.by(timeout)?;
        let work = async { Some(self.halves.latest_rx.lock().await.as_mut()?.latest().await) };
        self.using(py, by, work, none)?
            .map(|value| PyBytes::new(py, &value.0))
            .map_err(|e| errors::receiving(&e))
    }

    fn try_latest<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let work = async { Some(self.halves.latest_rx.lock().await.as_mut()?.try_latest()) };
        let value = self.using(py, None, work, none)?;
        value.map(|value| value.map(|value| PyBytes::new(py, &value.0))).map_err(|e| errors::receiving(&e))
    }

    /// Sends a frame. Once it has begun a signal ends the wait, and not the frame.
    fn send_frame(
        &self,
        py: Python<'_>,
        number: Option<u32>,
        header: &[u8],
        items: PyBackedBytes,
    ) -> PyResult<u32> {
        let engine = engine()?;
        let Setup { hello, options, .. } = self.setup.get();
        let (count, most) = (items.len() / hello.format().item, options.link.max_frame);
        if count > most as usize {
            let text = format!("a frame of {count} items: at most {most} may be sent (max_frame)");
            return Err(PyValueError::new_err(text));
        }
        let (halves, header) = (Arc::clone(&self.halves), RawValue::from(header));
        let (done, sent) = oneshot::channel();
        engine.net.spawn(Box::pin(async move {
            let work = async {
                let mut frames = halves.frames_tx.lock().await;
                Some(send(frames.as_mut()?, number, header, &items).await)
            };
            let _nobody = done.send(halves.until_closed(work).await);
        }));
        match engine.run(py, sent)?.ok().flatten() {
            Some(Ok(number)) => Ok(number),
            Some(Err(Some(error))) => Err(errors::sending(&error)),
            Some(Err(None)) => Err(errors::other("a publisher sends the frames of this link")),
            None => Err(errors::closed_here()),
        }
    }

    fn frame<'py>(&self, py: Python<'py>, timeout: Option<f64>) -> PyResult<Frame<'py>> {
        let by = engine()?.by(timeout)?;
        let work = async { Some(self.halves.frames_rx.lock().await.as_mut()?.frame().await) };
        let frame = self.using(py, by, work, none)?;
        let WholeFrame { start, batches, age, skipped, .. } = frame.map_err(|e| errors::receiving(&e))?;
        let length = batches.iter().map(|batch| batch.as_bytes().len()).sum();
        let items = PyByteArray::new_with(py, length, |mut items| {
            for batch in &batches {
                let Some((part, rest)) = items.split_at_mut_checked(batch.as_bytes().len()) else { break };
                part.copy_from_slice(batch.as_bytes());
                items = rest;
            }
            Ok(())
        })?;
        let skipped = (skipped.replaced, skipped.expired, skipped.incomplete);
        Ok((start.frame.0, PyBytes::new(py, &start.header.0), items, age.as_secs_f64(), skipped))
    }

    fn keep_last(&self, py: Python<'_>, depth: usize, lifespan: Option<f64>) -> PyResult<()> {
        let engine = engine()?;
        let now = engine.net.now();
        let depth =
            depth.try_into().map_err(|_| PyValueError::new_err("a depth of 0 frames: give 1 or more"))?;
        let rule = KeepLast::new(depth).with_lifespan(engine.by(lifespan)?.map(|by| by.since(now)));
        engine.run(py, async {
            let mut half = self.halves.frames_rx.lock().await;
            *half = half.take().map(|frames| frames.keep_last(rule));
        })
    }

    fn send_message(&self, py: Python<'_>, message: &[u8]) -> PyResult<()> {
        let message = Raw::from(message);
        let work = async { Some(self.halves.messages_tx.lock().await.as_mut()?.send(&message).await) };
        self.using(py, None, work, none)?.map_err(|e| errors::sending(&e))
    }

    fn message<'py>(&self, py: Python<'py>, timeout: Option<f64>) -> PyResult<Bound<'py, PyBytes>> {
        let by = engine()?.by(timeout)?;
        let work = async { Some(self.halves.messages_rx.lock().await.as_mut()?.recv().await) };
        self.using(py, by, work, none)?
            .map(|message| PyBytes::new(py, &message))
            .map_err(|e| errors::receiving(&e))
    }

    /// Sends a blob. An exception, also one of `progress`, cancels it.
    fn send_blob(&self, py: Python<'_>, blob: PyBackedBytes, progress: Option<Py<PyAny>>) -> PyResult<()> {
        let (length, sent) = (blob.len() as u64, AtomicU64::new(0));
        let counted = &sent;
        let blob = Bytes::from_owner(blob);
        let count = |bytes| counted.store(bytes, Ordering::Relaxed);
        let work = async { Some(self.halves.bulk_tx.lock().await.as_mut()?.send(blob, count).await) };
        let mut teller = Teller { progress, told: None };
        let tick = |py: Python<'_>| teller.tell(py, (counted.load(Ordering::Relaxed), length));
        self.using(py, None, work, tick)?.map_err(|e| errors::sending(&e))?;
        teller.tell(py, (length, length))
    }

    /// Receives a blob.
    fn blob<'py>(
        &self,
        py: Python<'py>,
        timeout: Option<f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let by = engine()?.by(timeout)?;
        let come = Lock::new((0, 0));
        let counted = &come;
        let work = async { Some(whole_blob(self.halves.bulk_rx.lock().await.as_mut()?, counted).await) };
        let mut teller = Teller { progress, told: None };
        let tick = |py: Python<'_>| {
            let (received, length) = *counted.lock();
            if length > 0 { teller.tell(py, (received, length)) } else { Ok(()) }
        };
        let blob = self.using(py, by, work, tick)?.map_err(|e| errors::blob(&e))?;
        match blob {
            Ok(blob) => {
                let length = blob.len() as u64;
                teller.tell(py, (length, length))?;
                Ok(PyBytes::new(py, &blob))
            }
            Err((received, length)) => {
                let text = format!("{} gave up a blob after {received} of {length} bytes", self.peer.name);
                Err(errors::other(&text))
            }
        }
    }

    /// Closes the link. Ends every wait for it.
    fn close(&self, py: Python<'_>, code: u16, why: &str) -> PyResult<()> {
        let Some(close) = self.close.lock().take() else { return Ok(()) };
        let (done, closed) = oneshot::channel();
        if close.send((CloseReason::new(code, why), done)).is_err() {
            return Ok(());
        }
        match engine()?.run(py, closed)? {
            Ok(Err(error)) => Err(errors::sending(&error)),
            Ok(Ok(())) | Err(_) => Ok(()),
        }
    }
}

/// Tells a callback of progress, once for each state.
struct Teller {
    progress: Option<Py<PyAny>>,
    told: Option<(u64, u64)>,
}

impl Teller {
    fn tell(&mut self, py: Python<'_>, now: (u64, u64)) -> PyResult<()> {
        if self.told.replace(now) != Some(now)
            && let Some(progress) = &self.progress
        {
            progress.call1(py, now)?;
        }
        Ok(())
    }
}

/// Nothing is to be told.
fn none(_: Python<'_>) -> PyResult<()> {
    Ok(())
}

/// The next blob. Or how far it was when the peer gave it up.
async fn whole_blob(
    half: &mut BlobReceiver,
    come: &Lock<(u64, u64)>,
) -> Result<Result<Bytes, (u64, u64)>, BlobError> {
    loop {
        match half.recv().await? {
            BlobEvent::Progress { received, length } => *come.lock() = (received, length),
            BlobEvent::Whole(blob) => return Ok(Ok(blob)),
            BlobEvent::Cancelled { received, length } => return Ok(Err((received, length))),
            _ => {}
        }
    }
}
