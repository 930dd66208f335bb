//! The native half of the Python package `trimaran-transport`: links of bytes. Its other half, in Python, has
//! the dtypes.
//!
//! | module | contents |
//! |---|---|
//! | `runtime` | the tasks behind all links, and waits that a signal ends |
//! | `setup` | a protocol, a hello and options |
//! | `keys` | key files |
//! | `listener`, `link`, `publisher` | the classes of the same names |
//! | `halves`, `subscription` | the state of a link, for any thread |
//! | `errors` | exceptions |

mod errors;
mod halves;
mod keys;
mod link;
mod listener;
mod publisher;
mod runtime;
mod setup;
mod subscription;

/// Links of bytes.
#[pyo3::pymodule(name = "_native")]
mod native {
    #[pymodule_export]
    use super::keys::{Keys, PublicKeys};
    #[pymodule_export]
    use super::link::{Link, connect};
    #[pymodule_export]
    use super::listener::{Listener, listen};
    #[pymodule_export]
    use super::publisher::Publisher;
    #[pymodule_export]
    use super::setup::Setup;
}
