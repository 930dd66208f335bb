//! Leaving, and finding out that a peer has left.

use std::future::{Future, pending};

use trimaran_proto::CloseCode;
use trimaran_transport::{CloseReason, RecvError, SendError, causes};

use super::error::{LinkError, RoleError};
use crate::{
    links::{LatestReceiver, Link},
    stop::Stop,
    turn::Turn,
};

/// What a role's work gives, unless the role is asked to stop.
pub(super) async fn worked(
    work: impl Future<Output = Result<(), RoleError>>,
    turn: &Turn,
    stop: &Stop,
) -> Result<(), RoleError> {
    let work = turn.given_back_while_waiting(work);
    let result = stop.unless_requested(work).await.unwrap_or(Err(RoleError::Stopped));
    turn.give_back();
    match result {
        // A device that gave up a wait because the role was asked to stop has not failed.
        Err(error) if error.device_failure().is_some() && stop.requested() => {
            tracing::debug!(error = &error as &dyn std::error::Error, "the device's work was left");
            Err(RoleError::Stopped)
        }
        result => result,
    }
}

/// Leaves both peers, and says how the role ended whose work gave `result`.
pub(super) async fn part(
    mut links: [Link; 2],
    mut result: Result<(), RoleError>,
    stop: &Stop,
) -> Result<(), RoleError> {
    // What a peer said when it left says more than the failure to send to it afterwards.
    if let Err(RoleError::Link { doing, cause: LinkError::Send(SendError::Lost { peer, .. }) }) = &result
        && let Some(link) = links.iter_mut().find(|link| link.peer.name == *peer)
        && let Some(cause @ RecvError::Closed { .. }) = stop.unless_requested(last_word(link)).await
    {
        result = Err(RoleError::Link { doing, cause: cause.into() });
    }
    leave(links, result.as_ref().map_or_else(reason, |()| CloseCode::Finished.reason())).await;
    match result {
        // Whoever was asked to stop does not ask why the others left: they may have been asked as well.
        Err(error) if error.is_clean_end() || stop.requested() && error.lost_a_peer() => Ok(()),
        result => result,
    }
}

/// Leaves both peers before the session has begun, because this role cannot play in it. Gives `error` back.
pub async fn leave_unable(links: [Link; 2], error: RoleError) -> RoleError {
    leave(links, reason(&error)).await;
    error
}

/// What peers are told of how this role ended.
fn reason(error: &RoleError) -> CloseReason {
    match error {
        RoleError::Stopped => CloseCode::Interrupted.reason(),
        error if error.is_clean_end() => CloseCode::Finished.reason(),
        error if error.lost_a_peer() => CloseCode::PeerLost.because(&causes(error)),
        error => match error.device_failure() {
            Some(cause) => CloseCode::DeviceFailed.because(&causes(cause)),
            None => CloseCode::Failed.because(&causes(error)),
        },
    }
}

/// Says close on both links. A peer that is gone already does not
/// hear it, and need not.
async fn leave(links: [Link; 2], reason: CloseReason) {
    for link in links {
        if let Err(cause) = link.close(reason.clone()).await {
            tracing::debug!(%cause, "a close was not heard");
        }
    }
}

/// How a peer left that sends nothing on this lane. Never ends where it has finished: what it sent before
/// that may still be to be read on the other lane.
pub(super) async fn left_early(lane: &mut LatestReceiver) -> RecvError {
    loop {
        match lane.latest().await {
            Ok(_) | Err(RecvError::Silent { .. }) => {}
            Err(RecvError::Closed { reason, .. }) if CloseCode::of(&reason) == Some(CloseCode::Finished) => {
                return pending().await;
            }
            Err(end) => return end,
        }
    }
}

/// How a link ended, whose peer is gone: behind cameras that nobody has read, and where its two lanes are two
/// connections perhaps a little later than the other one.
async fn last_word(link: &mut Link) -> RecvError {
    loop {
        if let Err(end) = link.latest_rx.latest().await {
            return end;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use trimaran_proto::{Camera, FrameNumber, Identity, Role, SceneHash, Walkthrough};
    use trimaran_transport::{LinkConfig, Net, TokioNet, inproc};

    use super::*;
    use crate::{driver::error::link, links::FrameStart};

    /// How a culler ends that cannot begin a frame any more for a display that handed out a camera, and went;
    /// `asked` to stop itself or not.
    fn begin_after(close: Option<CloseReason>, asked: bool) -> Result<(), RoleError> {
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().start_paused(true).build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let identity = |role| Identity { role, scene: SceneHash(1), settings: None };
        let join = |role| {
            inproc::pair::<Walkthrough>(
                &net,
                identity(role),
                identity(Role::SecondCuller),
                &LinkConfig::default(),
            )
            .unwrap()
        };
        let ((mut display, mut to_display), (_other, to_other)) =
            (join(Role::Display), join(Role::FirstCuller));
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(0)).unwrap();
        display.latest_tx.publish(camera).unwrap();
        let (stopper, stop) = Stop::new();
        if asked {
            stopper.stop();
        }
        runtime.block_on(async {
            match close {
                Some(reason) => display.close(reason).await.unwrap(),
                None => drop(display),
            }
            let start = FrameStart { frame: FrameNumber(0), header: camera };
            let begin = to_display.frames_tx.begin(start).await.map_err(link("beginning a frame"));
            assert!(matches!(begin, Err(RoleError::Link { cause: LinkError::Send(_), .. })), "{begin:?}");
            part([to_other, to_display], begin, &stop).await
        })
    }

    #[test]
    fn a_display_that_left_is_not_lost_though_its_last_camera_was_not_read() {
        begin_after(Some(CloseCode::Finished.reason()), false).unwrap();
        let failed = begin_after(Some(CloseCode::Failed.because("no memory")), false).unwrap_err();
        assert!(!failed.is_clean_end() && !failed.lost_a_peer(), "{failed:?}");
        let broken = CloseCode::DeviceFailed.because("the device was lost");
        let broken = begin_after(Some(broken), false).unwrap_err();
        assert!(!broken.is_clean_end() && broken.lost_a_peer(), "{broken:?}");
    }

    #[test]
    fn a_display_that_was_interrupted_has_not_finished_and_may_come_again() {
        let interrupted = begin_after(Some(CloseCode::Interrupted.reason()), false).unwrap_err();
        assert!(interrupted.lost_a_peer() && !interrupted.is_clean_end(), "{interrupted:?}");
        begin_after(Some(CloseCode::Interrupted.reason()), true).unwrap();
        let failed = begin_after(Some(CloseCode::Failed.because("no memory")), true);
        assert!(failed.is_err(), "a failure is told all the same");
    }

    #[test]
    fn a_display_that_went_without_a_word_is_lost() {
        let gone = begin_after(None, false).unwrap_err();
        assert!(gone.lost_a_peer() && !gone.is_clean_end(), "{gone:?}");
    }
}
