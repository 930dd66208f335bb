//! Leaving, and finding out that a peer has left.

use std::future::pending;

use crate::{LatestReceiver, Link};
use tokio::runtime::Handle;
use trimaran_proto::CloseCode;
use trimaran_transport::{CloseReason, RecvError, SendError};

use crate::causes;

use super::{LinkError, RoleError, Stop, stop::Waiting};

/// Says close on both links, giving the reason that `result` gives. A peer that is gone already does not
/// hear it, and need not.
pub(super) fn leave<D: std::error::Error + 'static>(
    runtime: &Handle,
    links: [Link; 2],
    result: &Result<(), RoleError<D>>,
) {
    let reason = match result {
        Ok(()) => CloseCode::Finished.reason(),
        Err(RoleError::Stopped) => CloseCode::Interrupted.reason(),
        Err(error) if error.is_clean_end() => CloseCode::Finished.reason(),
        Err(error) if error.lost_a_peer() => CloseCode::PeerLost.because(&causes(error)),
        Err(error) => match error.device_failure() {
            Some(cause) => CloseCode::DeviceFailed.because(&causes(cause)),
            None => CloseCode::Failed.because(&causes(error)),
        },
    };
    part(runtime, links, &reason);
}

fn part(runtime: &Handle, links: [Link; 2], reason: &CloseReason) {
    runtime.block_on(async {
        for link in links {
            if let Err(cause) = link.close(reason.clone()).await {
                tracing::debug!(%cause, "a close was not heard");
            }
        }
    });
}

/// Leaves both peers before the session has begun, because this role's device cannot play in it.
pub fn leave_unable(runtime: &Handle, links: [Link; 2], why: &str) {
    part(runtime, links, &CloseCode::DeviceFailed.because(why));
}

/// What a role returns for how its work ended. Whoever was asked to stop does not ask why the others left:
/// they may have been asked as well.
pub(super) fn ended<D: std::error::Error + 'static>(
    result: Result<(), RoleError<D>>,
    stop: &Stop,
) -> Result<(), RoleError<D>> {
    match result {
        Err(error) if error.is_clean_end() || stop.requested() && error.lost_a_peer() => Ok(()),
        result => result,
    }
}

/// Puts what a peer said when it left in the place of the failure to send to it afterwards.
pub(super) fn hear_out<D: std::error::Error + 'static>(
    result: Result<(), RoleError<D>>,
    links: [&mut Link; 2],
    waiting: Waiting<'_>,
) -> Result<(), RoleError<D>> {
    match &result {
        Err(RoleError::Link { doing, cause: LinkError::Send(SendError::Lost { peer, .. }) }) => {
            let link = links.into_iter().find(|link| link.peer.name == *peer);
            let heard = link.and_then(|link| waiting.on(last_word(link)));
            match heard {
                Some(cause @ RecvError::Closed { .. }) => {
                    Err(RoleError::Link { doing, cause: LinkError::Receive(cause) })
                }
                _ => result,
            }
        }
        _ => result,
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
    use std::convert::Infallible;
    use std::sync::Arc;

    use crate::FrameStart;
    use trimaran_proto::{Camera, FrameNumber, Identity, Role, SceneHash, Walkthrough};
    use trimaran_transport::{LinkConfig, Net, TokioNet, inproc};

    use super::super::{Turns, wait};
    use super::*;
    use crate::Stopwatch;

    /// What a machine makes of it that it cannot begin a frame any more for a display that handed out a
    /// camera, and went.
    fn begin_after(close: Option<CloseReason>) -> RoleError<Infallible> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let identity = |role| Identity { role, scene: SceneHash(1), settings: None };
        let join = |role| {
            inproc::pair::<Walkthrough>(&net, identity(role), identity(Role::SwitchB), &LinkConfig::default())
                .unwrap()
        };
        let ((mut display, mut to_display), (_other, mut to_other)) =
            (join(Role::Display), join(Role::SwitchA));
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(0)).unwrap();
        display.latest_tx.publish(camera).unwrap();
        match close {
            Some(reason) => runtime.block_on(display.close(reason)).unwrap(),
            None => drop(display),
        }
        let (_stopper, stop) = Stop::new();
        let turn = Turns::at_once().of_a_role(Stopwatch::start());
        let waiting = Waiting { runtime: runtime.handle(), stop: &stop, turn: &turn };
        let start = FrameStart { frame: FrameNumber(0), header: camera };
        let begin = to_display.frames_tx.begin(start);
        let result = wait(waiting, "beginning a frame", begin).map(|_| ());
        assert!(matches!(result, Err(RoleError::Link { cause: LinkError::Send(_), .. })), "{result:?}");
        hear_out(result, [&mut to_other, &mut to_display], waiting).unwrap_err()
    }

    #[test]
    fn a_display_that_left_is_not_lost_though_its_last_camera_was_not_read() {
        let finished = begin_after(Some(CloseCode::Finished.reason()));
        assert!(finished.is_clean_end() && !finished.lost_a_peer(), "{finished:?}");
        let failed = begin_after(Some(CloseCode::Failed.because("no memory")));
        assert!(!failed.is_clean_end() && !failed.lost_a_peer(), "{failed:?}");
        let broken = begin_after(Some(CloseCode::DeviceFailed.because("the device was lost")));
        assert!(!broken.is_clean_end() && broken.lost_a_peer(), "{broken:?}");
    }

    #[test]
    fn a_display_that_was_interrupted_has_not_finished_and_may_come_again() {
        let interrupted = begin_after(Some(CloseCode::Interrupted.reason()));
        assert!(interrupted.lost_a_peer() && !interrupted.is_clean_end(), "{interrupted:?}");
        let (stopper, stop) = Stop::new();
        let lost = |error: &RoleError<Infallible>| error.lost_a_peer();
        assert!(ended(Err(interrupted), &stop).is_err_and(|error| lost(&error)));
        stopper.stop();
        assert!(
            ended(Err(begin_after(Some(CloseCode::Interrupted.reason()))), &stop).is_ok(),
            "it was asked itself"
        );
        let failed = begin_after(Some(CloseCode::Failed.because("no memory")));
        assert!(ended(Err(failed), &stop).is_err(), "a failure is told all the same");
    }

    #[test]
    fn a_display_that_went_without_a_word_is_lost() {
        let gone = begin_after(None);
        assert!(gone.lost_a_peer() && !gone.is_clean_end(), "{gone:?}");
    }
}
