//! A protocol, a hello and options: what a side of a link is set up with.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trimaran_transport::keys::{KnownPeer, Security};
use trimaran_transport::untyped::{Raw, UntypedHello};
use trimaran_transport::{BatchSize, Options};

use crate::errors::mistake;
use crate::keys::{Keys, PublicKeys};

/// One side.
#[pyclass(frozen, module = "trimaran_transport._native")]
pub(crate) struct Setup {
    pub(crate) hello: UntypedHello,
    pub(crate) options: Options,
    /// The longest blob that is received, bytes.
    pub(crate) max_blob: u64,
}

#[pymethods]
impl Setup {
    /// `options` is JSON.
    #[new]
    #[pyo3(signature = (*, name, sizes, hello, options, keys, peers, batch, max_frame, max_blob))]
    #[expect(clippy::too_many_arguments, reason = "Python names them")]
    fn new(
        name: &str,
        sizes: (usize, usize, usize),
        hello: &[u8],
        options: &str,
        keys: Option<&Keys>,
        peers: Vec<PyRef<'_, PublicKeys>>,
        batch: u32,
        max_frame: u32,
        max_blob: u64,
    ) -> PyResult<Self> {
        let (latest, header, item) = sizes;
        let hello =
            UntypedHello::new(name, latest, header, item, Raw::from(hello)).map_err(|e| mistake(&e))?;
        let mut options: Options = serde_json::from_str(options)
            .map_err(|error| PyValueError::new_err(format!("these options cannot be used: {error}")))?;
        options.link.batching.size = BatchSize::new(batch).map_err(|e| mistake(&e))?;
        options.link.max_frame = max_frame;
        let peers = peers.iter().map(|peer| KnownPeer::from(peer.0.clone())).collect();
        options.security = keys.map(|keys| Security { keys: keys.0.clone(), peers });
        Ok(Self { hello, options, max_blob })
    }
}
