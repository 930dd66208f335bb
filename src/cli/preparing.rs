//! The page of `view` while its model is read and cooked: it is open from the first second.

use std::net::SocketAddr;

use tokio::runtime::Runtime;
use trimaran::page::{FrameAncestor, Preparation, Token};
use trimaran_transport::{TokioNet, ws::WsOptions};

use super::{
    Failure,
    address::Address,
    browser::{self, Redirect},
    import::READING,
    walking::runtime,
};

/// A page that shows progress.
pub(super) struct Preparing {
    preparation: Preparation,
    at: SocketAddr,
    token: Token,
    /// The file that a browser was opened with.
    opened: Option<Redirect>,
    /// Its end closes the port.
    _runtime: Runtime,
}

/// Where a page was opened.
pub(super) struct Opened {
    pub(super) listen: SocketAddr,
    pub(super) token: Token,
    pub(super) redirect: Option<Redirect>,
}

impl Preparing {
    /// Serves it at the model's address, and opens it in a browser if it `is_to_open`. `None` if it
    /// cannot be served: then the page comes once the model is there, or the service says why not.
    pub(super) fn begin(
        address: &Address,
        ws: &WsOptions,
        ancestors: &[FrameAncestor],
        is_to_open: bool,
    ) -> Option<Self> {
        let runtime = runtime().ok()?;
        let preparation = Preparation::default();
        let token = address.token(&TokioNet::new(runtime.handle().clone())).ok()?;
        preparation.begin(READING, 0);
        let at = preparation.serve(&token, address.listen(), ws, ancestors, runtime.handle()).ok()??;
        let url = format!("http://{at}/?token={}", token.as_str());
        let opened = if is_to_open { browser::open(&url).ok() } else { None };
        Some(Self { preparation, at, token, opened, _runtime: runtime })
    }

    pub(super) fn preparation(&self) -> Preparation {
        self.preparation.clone()
    }

    /// Shows why there is no model.
    pub(super) fn fail(&self, why: &Failure) {
        self.preparation.fail(&why.to_string(), self.opened.is_some());
    }

    /// Leaves the port to the service that shows the model.
    pub(super) fn end(self) -> Opened {
        Opened { listen: self.at, token: self.token, redirect: self.opened }
    }
}
