//! The host on which a program runs, for programs that do not hand a network around.

use std::cell::RefCell;
use std::io;
use std::mem;
use std::pin::Pin;
use std::task::{Context, Poll};

use super::SimNet;
use crate::host::HostId;

/// The place of a program that runs on no host: it has time and no sockets.
pub(crate) const NOWHERE: HostId = HostId(usize::MAX);

thread_local! {
    static CURRENT: RefCell<Option<SimNet>> = const { RefCell::new(None) };
}

/// A program that runs on a host; see [`SimNet::scope`].
#[derive(Debug)]
pub struct Scope<F> {
    pub(crate) net: SimNet,
    pub(crate) program: F,
}

impl<F: Future + Unpin> Future for Scope<F> {
    type Output = F::Output;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<F::Output> {
        let _entered = Entered::enter(self.net.clone());
        Pin::new(&mut self.program).poll(cx)
    }
}

/// While this lives, the program is on a host. Scopes may be within each other.
struct Entered(Option<SimNet>);

impl Entered {
    fn enter(net: SimNet) -> Self {
        Self(CURRENT.replace(Some(net)))
    }
}

impl Drop for Entered {
    fn drop(&mut self) {
        let outer = mem::take(&mut self.0);
        CURRENT.set(outer);
    }
}

/// The network of the running program, if it is in a simulation.
pub(crate) fn current() -> Option<SimNet> {
    CURRENT.with_borrow(Clone::clone)
}

/// The network of the host on which the running program is.
///
/// # Errors
/// If it is on none.
pub(crate) fn here() -> io::Result<SimNet> {
    let nowhere = "this program runs on no simulated host: use `SimNet::scope` or `Net::spawn`";
    current().filter(|net| net.host != NOWHERE).ok_or_else(|| io::Error::other(nowhere))
}
