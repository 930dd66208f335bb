//! Exceptions, from the errors of the crate. Their classes are in Python.

use std::error::Error;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use trimaran_transport::keys::KeysError;
use trimaran_transport::{
    AcceptError, BlobError, CloseReason, ConnectError, ListenError, PeerName, RecvError, SendError, causes,
};

/// An exception of one of the package's classes, with the text of the error and of its causes.
fn exception(class: &str, error: &dyn Error) -> PyErr {
    let mut texts = vec![error.to_string()];
    let mut next = error.source();
    while let Some(cause) = next {
        texts.push(cause.to_string());
        next = cause.source();
    }
    of_class(class, (causes(error), texts))
}

fn of_class<A>(class: &str, arguments: A) -> PyErr
where
    A: pyo3::PyErrArguments + Send + Sync + 'static,
{
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    Python::attach(|py| {
        let module =
            MODULE.get_or_try_init(py, || py.import("trimaran_transport._errors").map(Bound::unbind))?;
        let class = module.bind(py).getattr(class)?.cast_into::<PyType>()?;
        Ok(PyErr::from_type(class, arguments))
    })
    .unwrap_or_else(|error: PyErr| error)
}

/// A mistake of the caller.
pub(crate) fn mistake(error: &dyn Error) -> PyErr {
    PyValueError::new_err(causes(error))
}

pub(crate) fn connecting(error: &ConnectError) -> PyErr {
    may_pass(exception("ConnectError", error), error.may_pass())
}

pub(crate) fn listening(error: &ListenError) -> PyErr {
    may_pass(exception("ConnectError", error), error.may_pass())
}

fn may_pass(exception: PyErr, may_pass: bool) -> PyErr {
    Python::attach(|py| {
        let set = exception.value(py).setattr("may_pass", may_pass);
        set.err().unwrap_or(exception)
    })
}

pub(crate) fn accepting(error: &AcceptError) -> PyErr {
    match error {
        AcceptError::Deadline { .. } => exception("TransportTimeout", error),
        _ => exception("TransportError", error),
    }
}

pub(crate) fn receiving(error: &RecvError) -> PyErr {
    match error {
        RecvError::Closed { reason, .. } => closed(causes(error), reason),
        RecvError::Deadline { .. } => exception("TransportTimeout", error),
        RecvError::Protocol { .. } => exception("ProtocolError", error),
        _ => exception("LinkLost", error),
    }
}

pub(crate) fn sending(error: &SendError) -> PyErr {
    match error {
        SendError::Order { .. } | SendError::TooLong { .. } => mistake(error),
        _ => exception("LinkLost", error),
    }
}

pub(crate) fn blob(error: &BlobError) -> PyErr {
    match error {
        BlobError::Link(error) => receiving(error),
        BlobError::Malformed => exception("ProtocolError", error),
        _ => exception("TransportError", error),
    }
}

pub(crate) fn keys(error: &KeysError) -> PyErr {
    exception("KeysError", error)
}

/// The link was closed, by either side.
pub(crate) fn closed(text: String, reason: &CloseReason) -> PyErr {
    let why = reason.why.to_string();
    of_class("LinkClosed", (text.clone(), vec![text], reason.code, why))
}

/// The link of this side is closed.
pub(crate) fn closed_here() -> PyErr {
    closed("this side has closed the link".to_owned(), &CloseReason::new(0, "this side has closed the link"))
}

/// Nothing came in time.
pub(crate) fn late(peer: &PeerName) -> PyErr {
    receiving(&RecvError::Deadline { peer: peer.clone() })
}

/// An error that the crate has no type for.
pub(crate) fn other(text: &str) -> PyErr {
    of_class("TransportError", (text.to_owned(), vec![text.to_owned()]))
}
