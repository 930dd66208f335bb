//! Closing links, and detecting that a peer has closed.

use std::future::Future;

use futures_util::future::join_all;
use trimaran_proto::CloseCode;
use trimaran_transport::{CloseReason, RecvError, SendError, causes};

use super::error::{LinkError, RoleError};
use crate::{
    links::{LatestReceiver, Link},
    stop::Stop,
};

/// The result of a role's work, unless the role is asked to stop.
pub(super) async fn worked(
    work: impl Future<Output = Result<(), RoleError>>,
    stop: &Stop,
) -> Result<(), RoleError> {
    match stop.unless_requested(work).await.unwrap_or(Err(RoleError::Stopped)) {
        // A device that gave up a wait because of a stop request has not failed.
        Err(error) if error.is_of_a_device() && stop.requested() => {
            tracing::debug!(error = &error as &dyn std::error::Error, "the device's work was left");
            Err(RoleError::Stopped)
        }
        result => result,
    }
}

/// Closes all links, and determines how the role with this `result` ended.
pub(super) async fn part(
    mut links: Vec<Link>,
    mut result: Result<(), RoleError>,
    stop: &Stop,
) -> Result<(), RoleError> {
    // A peer's close says more than the later failure to send to it.
    if let Err(RoleError::Link { doing, cause: LinkError::Send(SendError::Lost { peer, .. }) }) = &result
        && let Some(link) = links.iter_mut().find(|link| link.peer.name == *peer)
        && let Some(cause @ RecvError::Closed { .. }) = stop.unless_requested(last_word(link)).await
    {
        result = Err(RoleError::Link { doing, cause: cause.into() });
    }
    let reason = result.as_ref().map_or_else(reason, |()| CloseCode::Finished.reason());
    let _unheard = stop.unless_insisted(leave(links, reason)).await;
    match result {
        // After a stop request the other roles' ends do not matter: they may have been asked as well.
        Err(error) if error.is_clean_end() || stop.requested() && error.lost_a_peer() => Ok(()),
        result => result,
    }
}

/// The close reason for this role's end.
pub(crate) fn reason(error: &RoleError) -> CloseReason {
    match error {
        RoleError::Stopped => CloseCode::Interrupted.reason(),
        error if error.is_clean_end() => CloseCode::Finished.reason(),
        error => match error.device_failure() {
            Some(cause) => CloseCode::DeviceFailed.because(&causes(cause)),
            None => CloseCode::Failed.because(&causes(error)),
        },
    }
}

/// Sends a close on all links at once. A peer that is gone misses it.
pub(crate) async fn leave(links: Vec<Link>, reason: CloseReason) {
    let each = links.into_iter().map(|link| async {
        if let Err(cause) = link.close(reason.clone()).await {
            tracing::debug!(%cause, "a close was not heard");
        }
    });
    join_all(each).await;
}

/// Closes a link before the session has begun, because this role cannot play in it.
pub(crate) async fn leave_unable(link: Link, error: &RoleError) {
    leave(vec![link], reason(error)).await;
}

/// Waits for the close of a culler, which sends nothing on this lane.
pub(super) async fn left_early(lane: &mut LatestReceiver) -> RecvError {
    loop {
        match lane.latest().await {
            Ok(_) => {}
            Err(end) => return end,
        }
    }
}

/// How the link of a lost peer ended: behind unread cameras. If its two lanes are two connections, its close
/// may come a little later than the other one's.
async fn last_word(link: &mut Link) -> RecvError {
    loop {
        if let Err(end) = link.latest_rx.latest().await {
            return end;
        }
    }
}
