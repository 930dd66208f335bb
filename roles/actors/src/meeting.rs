//! How two cullers get a link to each other, for the schedule `switch`: the display introduces them.
//!
//! A display may be a stranger, so it names no address: it picks one of the endpoints that the culler was
//! configured with. A culler takes links of others only while a display of its own waits for one.

use std::{collections::HashMap, sync::Arc, time::Duration};

use parking_lot::Mutex;
use thiserror::Error;
use tokio::sync::oneshot;
use trimaran_proto::{Identity, Role, SceneOutline, SessionKey, Settings, Walkthrough};
use trimaran_transport::{ConnectError, Endpoint, Instant, Net, Options, connect, sleep_until};

use crate::links::Link;

/// How long two cullers may take to meet.
const LIMIT: Duration = Duration::from_secs(10);
/// A session connects to other cullers once in so long at most.
const PACE: Duration = Duration::from_secs(1);

/// How a culler in a session meets another one.
#[derive(Debug, Clone)]
pub struct Meeting {
    /// The time it waits by.
    pub net: Arc<dyn Net>,
    /// The scene.
    pub scene: SceneOutline,
    /// What the display has decided.
    pub settings: Settings,
    /// What holds for the link, and which cullers are known.
    pub options: Options,
    /// Where other cullers listen that it may connect to: no other endpoint is.
    pub cullers: Arc<[Endpoint]>,
    /// Cullers that come to this one.
    pub expected: Expected,
}

/// What comes of a meeting. It is called off when this is dropped.
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
        /// As much of it as a person can read.
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
    /// Connects to the other culler at one of the endpoints that are configured, and not before `earliest`.
    pub(crate) fn connect(&self, key: SessionKey, at: &str, earliest: Instant) -> Met {
        let (said, met) = oneshot::channel();
        let Some(endpoint) = self.cullers.iter().find(|culler| culler.to_string() == at).cloned() else {
            let at = at.chars().take(100).collect();
            let _waits = said.send(Err(MeetError::Unknown { at }));
            return met;
        };
        self.net.spawn(Box::pin(connect_unless_dropped(self.clone(), key, endpoint, earliest, said)));
        met
    }

    /// Waits for the other culler to come.
    pub(crate) fn wait(&self, key: SessionKey) -> Met {
        self.expected.wait(key)
    }

    /// When a session may connect the next time.
    pub(crate) fn next_at(&self, earliest: Instant) -> Instant {
        self.net.now().max(earliest).after(PACE)
    }
}

/// The other end of [`Met`].
type Said = oneshot::Sender<Result<Link, MeetError>>;

async fn connect_unless_dropped(
    Meeting { net, scene, settings, options, .. }: Meeting,
    key: SessionKey,
    endpoint: Endpoint,
    earliest: Instant,
    mut said: Said,
) {
    let identity = Identity { role: Role::Culler, scene: Some(scene), session: Some((key, settings)) };
    let attempt = async {
        sleep_until(&*net, earliest).await;
        connect::<Walkthrough>(&net, &endpoint, identity, &options, net.now().after(LIMIT)).await
    };
    tokio::select! {
        biased;
        () = said.closed() => {}
        link = attempt => {
            let link = link.map_err(|error| MeetError::Connect(Box::new(error)));
            let _unwanted = said.send(link);
        }
    }
}

/// Cullers that come to a culler because a display has sent them. There are as many at most as sessions.
#[derive(Debug, Clone, Default)]
pub struct Expected(Arc<Mutex<HashMap<SessionKey, Said>>>);

impl Expected {
    fn wait(&self, key: SessionKey) -> Met {
        let (said, met) = oneshot::channel();
        let mut waiting = self.0.lock();
        waiting.retain(|_, said| !said.is_closed());
        waiting.insert(key, said);
        met
    }

    /// A culler has come. One that nobody waits for is gone when this returns.
    pub(crate) fn came(&self, key: SessionKey, link: Link) {
        match self.0.lock().remove(&key) {
            Some(said) => {
                let _unwanted = said.send(Ok(link));
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

    /// What is configured has to be named as it is: nothing of what a display says becomes an address.
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

    /// Nothing is left of meetings that nobody waits for.
    #[tokio::test]
    async fn those_who_have_stopped_waiting_are_forgotten() {
        let expected = Expected::default();
        let met: Vec<_> = (0..1_000).map(|key| expected.wait(SessionKey(key))).collect();
        assert_eq!(expected.0.lock().len(), 1_000);
        drop(met);
        let mut one = expected.wait(SessionKey(7));
        assert_eq!(expected.0.lock().len(), 1);
        // A display that was started again has the key of the one before.
        let _again = expected.wait(SessionKey(7));
        assert!(one.try_recv().is_err() && expected.0.lock().len() == 1);
    }

    /// A meeting ends with the session that asked for it, also before it has begun.
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
