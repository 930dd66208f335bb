//! Keys of peers.

use std::path::PathBuf;

use pyo3::prelude::*;
use trimaran_transport::keys;

use crate::errors;

/// The private keys of a peer.
#[pyclass(frozen, module = "trimaran_transport")]
pub(crate) struct Keys(pub(crate) keys::Keys);

/// The public keys of a peer.
#[pyclass(frozen, module = "trimaran_transport")]
pub(crate) struct PublicKeys(pub(crate) keys::PublicKeys);

#[pymethods]
impl Keys {
    /// New keys, which live as long as this object unless they are saved.
    #[staticmethod]
    fn generate(name: &str) -> PyResult<Self> {
        let name = name.parse().map_err(|e| errors::mistake(&e))?;
        keys::Keys::generate(name).map(Self).map_err(|e| errors::keys(&e))
    }

    /// Reads a private file, which nobody else may be able to read.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        keys::Keys::read(&path).map(Self).map_err(|e| errors::keys(&e))
    }

    /// Writes NAME.key and NAME.pub into a folder, and returns their paths. Overwrites nothing.
    fn save(&self, folder: PathBuf) -> PyResult<(PathBuf, PathBuf)> {
        let files = self.0.save(&folder).map_err(|e| errors::keys(&e))?;
        Ok((files.private, files.public))
    }

    /// The matching public keys.
    #[getter]
    fn public(&self) -> PublicKeys {
        PublicKeys(self.0.public().clone())
    }

    fn __repr__(&self) -> String {
        format!("Keys({:?})", self.0.public().name.to_string())
    }
}

#[pymethods]
impl PublicKeys {
    /// Reads a public file.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        keys::PublicKeys::read(&path).map(Self).map_err(|e| errors::keys(&e))
    }

    /// The peer's name.
    #[getter]
    fn name(&self) -> String {
        self.0.name.to_string()
    }

    fn __repr__(&self) -> String {
        format!("PublicKeys({:?})", self.0.name.to_string())
    }
}
