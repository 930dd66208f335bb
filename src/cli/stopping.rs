//! Stopping a service: it tells its peers, and does not wait long for them.

use std::{process, thread, time::Duration};

use tokio::{
    runtime::{Builder, Handle},
    signal::unix::{SignalKind, signal},
};
use trimaran_actors::{Stop, Stopper};
use trimaran_transport::{Net, TokioNet, sleep_until, until};

use super::{Failure, log::SAID, service_manager::ServiceManager};

/// After a stop request, how long peers have to receive the close; then the time when the process exits
/// regardless.
const HEARD: Duration = Duration::from_millis(1200);
const ENDED: Duration = Duration::from_millis(2500);

/// A stop that Ctrl-C and systemd's termination signal set, and that a second one enforces. The process
/// always exits within 3 s of the first one, with exit code 0, since it was asked to.
///
/// # Errors
/// When signals cannot be received.
pub(super) fn stoppable_service() -> Result<(Stopper, Stop), Failure> {
    let (stopper, stop) = Stop::new();
    let asked = stopper.clone();
    // It has a thread and a runtime of its own, since those of links and sessions may be busy or stuck.
    let runtime = Builder::new_current_thread().enable_all().build().map_err(Failure::broken)?;
    let (mut interrupt, mut terminate) = {
        let _within = runtime.enter();
        let listen = |kind| signal(kind).map_err(Failure::broken);
        (listen(SignalKind::interrupt())?, listen(SignalKind::terminate())?)
    };
    let wait = move || {
        runtime.block_on(async move {
            let mut signalled = async || {
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                }
            };
            signalled().await;
            ServiceManager::stopping();
            stopper.stop();
            let net = TokioNet::new(Handle::current());
            let (heard, ended) = (net.now().after(HEARD), net.now().after(ENDED));
            let _again = until(&net, heard, signalled()).await;
            stopper.stop();
            sleep_until(&net, ended).await;
            tracing::warn!(target: SAID, "ends, though a session has not");
            process::exit(0);
        });
    };
    thread::Builder::new().name("signals".to_owned()).spawn(wait).map_err(Failure::broken)?;
    Ok((asked, stop))
}
