//! How two cullers get a link to each other, for the schedule `switch`: the display introduces them.
//!
//! Displays are not trusted, so they give no address: they choose one of the culler's configured endpoints. A
//! culler accepts links of others only while its own display waits for one.

use std::{collections::HashMap, sync::Arc, time::Duration};

use parking_lot::Mutex;
use thiserror::Error;
use tokio::sync::oneshot;
use trimaran_proto::{Identity, Role, SceneOutline, SessionKey, Settings, Walkthrough};
use trimaran_transport::{ConnectError, Endpoint, Instant, Net, Options, connect, sleep_until};

use crate::links::Link;

/// The timeout for connecting two cullers.
const LIMIT: Duration = Duration::from_secs(10);
/// The least time between a session's connections to other cullers.
const PACE: Duration = Duration::from_secs(1);

/// How a culler in a session connects to another one.
#[derive(Debug, Clone)]
pub struct Meeting {
    /// The clock.
    pub net: Arc<dyn Net>,
    /// The scene.
    pub scene: SceneOutline,
    /// The display's settings.
    pub settings: Settings,
    /// The options of the link, with the known cullers' keys.
    pub options: Options,
    /// The configured endpoints of other cullers: it connects to no others.
    pub cullers: Arc<[Endpoint]>,
    /// Expected cullers.
    pub expected: Expected,
}

/// The result of a meeting. Dropping it cancels the meeting.
pub(crate) type Met = oneshot::Receiver<Result<Link, MeetError>>;

/// Why a culler has no link to another one.
#[derive(Debug, Error)]
pub(crate) enum MeetError {
    /// The display names an endpoint that is not configured.
    #[error(
        "the display names {at:?}, which is not among the `cullers` of this culler's configuration: \
         if the two are to meet, add it there or with --cullers"
    )]
    Unknown {
        /// The readable part of it.
        at: String,
    },
    /// The other culler cannot be reached.
    #[error("the other culler cannot be reached")]
    Connect(#[source] Box<ConnectError>),
    /// It did not come.
    #[error("the other culler did not come")]
    Absent,
}

impl Meeting {
    /// Connects to the other culler at one of the configured endpoints, and not before `earliest`.
    pub(crate) fn connect(&self, key: SessionKey, at: &str, earliest: Instant) -> Met {
        let (sender, met) = oneshot::channel();
        let Some(endpoint) = self.cullers.iter().find(|culler| culler.to_string() == at).cloned() else {
            let at = at.chars().take(100).collect();
            let _waits = sender.send(Err(MeetError::Unknown { at }));
            return met;
        };
        self.net.spawn(Box::pin(connect_unless_dropped(self.clone(), key, endpoint, earliest, sender)));
        met
    }

    /// Waits for the other culler to come.
    pub(crate) fn wait(&self, key: SessionKey) -> Met {
        self.expected.wait(key)
    }

    /// When a session may connect again.
    pub(crate) fn next_at(&self, earliest: Instant) -> Instant {
        self.net.now().max(earliest).after(PACE)
    }
}

/// The other end of [`Met`].
type MetSender = oneshot::Sender<Result<Link, MeetError>>;

async fn connect_unless_dropped(
    Meeting { net, scene, settings, options, .. }: Meeting,
    key: SessionKey,
    endpoint: Endpoint,
    earliest: Instant,
    mut sender: MetSender,
) {
    let identity = Identity { role: Role::Culler, scene: Some(scene), session: Some((key, settings)) };
    let attempt = async {
        sleep_until(&*net, earliest).await;
        connect::<Walkthrough>(&net, &endpoint, identity, &options, net.now().after(LIMIT)).await
    };
    tokio::select! {
        biased;
        () = sender.closed() => {}
        link = attempt => {
            let link = link.map_err(|error| MeetError::Connect(Box::new(error)));
            let _unwanted = sender.send(link);
        }
    }
}

/// Cullers expected by a culler because a display has announced them. At most one per session.
#[derive(Debug, Clone, Default)]
pub struct Expected(Arc<Mutex<HashMap<SessionKey, MetSender>>>);

impl Expected {
    fn wait(&self, key: SessionKey) -> Met {
        let (sender, met) = oneshot::channel();
        let mut waiting = self.0.lock();
        waiting.retain(|_, sender| !sender.is_closed());
        waiting.insert(key, sender);
        met
    }

    /// A culler has come. If it is not expected, its link is closed.
    pub(crate) fn came(&self, key: SessionKey, link: Link) {
        match self.0.lock().remove(&key) {
            Some(sender) => {
                let _unwanted = sender.send(Ok(link));
            }
            None => tracing::debug!(from = %link.peer.address, "turned a culler away: nobody waits for it"),
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{LodRule, Viewport};
    use trimaran_transport::{Name, TokioNet};

    use super::*;

    fn meeting(cullers: &[Endpoint]) -> Meeting {
        Meeting {
            net: Arc::new(TokioNet::current().unwrap()),
            scene: SceneOutline::default(),
            settings: Settings::new(Viewport::new(8, 8).unwrap(), LodRule::new(1.0).unwrap()),
            options: Options::default(),
            cullers: cullers.into(),
            expected: Expected::default(),
        }
    }

    /// Endpoints must be named exactly as configured: no text of a display becomes an address.
    #[tokio::test]
    async fn a_display_names_no_address() {
        let meeting = meeting(&["tcp://127.0.0.1:7400".parse().unwrap()]);
        let now = meeting.net.now();
        for at in [
            "tcp://127.0.0.1:7401",
            "tcp://127.0.0.1:7400/",
            "TCP://127.0.0.1:7400",
            "tcp://localhost:7400",
            "ws://127.0.0.1:7400/admin?x=1",
            "unix:/run/docker.sock",
            "",
        ] {
            let met = meeting.connect(SessionKey(1), at, now).await.unwrap();
            assert!(matches!(met, Err(MeetError::Unknown { .. })), "{at}: {met:?}");
        }
    }

    /// Cancelled meetings leave nothing.
    #[tokio::test]
    async fn those_who_have_stopped_waiting_are_forgotten() {
        let expected = Expected::default();
        let met: Vec<_> = (0..1_000).map(|key| expected.wait(SessionKey(key))).collect();
        assert_eq!(expected.0.lock().len(), 1_000);
        drop(met);
        let mut one = expected.wait(SessionKey(7));
        assert_eq!(expected.0.lock().len(), 1);
        // A restarted display has the key of its predecessor.
        let _again = expected.wait(SessionKey(7));
        assert!(one.try_recv().is_err() && expected.0.lock().len() == 1);
    }

    /// A meeting ends with its session, also before it has begun.
    #[tokio::test(start_paused = true)]
    async fn a_meeting_that_is_dropped_is_called_off() {
        let meeting = meeting(&[Endpoint::Inproc(Name::unique())]);
        let at = meeting.cullers[0].to_string();
        let held = Arc::strong_count(&meeting.net);
        let now = meeting.net.now();
        for earliest in [now, now.after(LIMIT)] {
            let met = meeting.connect(SessionKey(1), &at, earliest);
            tokio::task::yield_now().await;
            assert!(Arc::strong_count(&meeting.net) > held, "it tries");
            drop(met);
            for _ in 0..9 {
                tokio::task::yield_now().await;
            }
            assert_eq!(Arc::strong_count(&meeting.net), held);
        }
        assert_eq!(meeting.net.now(), now);
    }

    #[tokio::test(start_paused = true)]
    async fn a_session_connects_once_a_second() {
        let meeting = meeting(&[]);
        let now = meeting.net.now();
        let mut earliest = now;
        for _ in 0..10 {
            earliest = meeting.next_at(earliest);
        }
        assert_eq!(earliest.since(now), 10 * PACE);
    }
}
