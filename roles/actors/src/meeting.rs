//! How two cullers get a link to each other, for the schedule `switch`: the display introduces them.

use std::{collections::VecDeque, sync::Arc, time::Duration};

use parking_lot::Mutex;
use tokio::sync::oneshot;
use trimaran_proto::{Identity, Role, SceneOutline, SessionKey, Settings, Walkthrough};
use trimaran_transport::{Endpoint, Net, Options, causes, connect};

use crate::links::Link;

/// How long two cullers may take to meet.
const LIMIT: Duration = Duration::from_secs(10);

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
    /// Cullers that come to this one.
    pub expected: Expected,
}

/// What comes of a meeting: a link, or why there is none.
pub(crate) type Met = oneshot::Receiver<Result<Link, String>>;

impl Meeting {
    /// Meets the other culler: where it listens, or else it comes.
    pub(crate) fn meet(&self, key: SessionKey, at: Option<String>) -> Met {
        let Some(at) = at else { return self.expected.expect(key) };
        let (said, met) = oneshot::channel();
        let Self { net, scene, settings, options, .. } = self.clone();
        self.net.spawn(Box::pin(async move {
            let identity =
                Identity { role: Role::Culler, scene: Some(scene), session: Some((key, settings)) };
            let link = match at.parse::<Endpoint>() {
                Ok(endpoint) => {
                    connect::<Walkthrough>(&net, &endpoint, identity, &options, net.now().after(LIMIT))
                        .await
                        .map_err(|error| causes(&error))
                }
                Err(error) => Err(causes(&error)),
            };
            let _unwanted = said.send(link);
        }));
        met
    }
}

/// Cullers that come to a culler because a display has sent them.
#[derive(Debug, Clone, Default)]
pub struct Expected(Arc<Mutex<Lists>>);

#[derive(Debug, Default)]
struct Lists {
    /// Whom somebody waits for.
    waiting: VecDeque<(SessionKey, oneshot::Sender<Result<Link, String>>)>,
    /// Who has come before the display said so.
    early: VecDeque<(SessionKey, Link)>,
}

impl Expected {
    /// How many come early, or are waited for, at most. The oldest are forgotten.
    const MOST: usize = 16;

    fn expect(&self, key: SessionKey) -> Met {
        let (said, met) = oneshot::channel();
        let mut lists = self.0.lock();
        let early = lists.early.iter().position(|(early, _)| *early == key);
        match early.and_then(|place| lists.early.remove(place)) {
            Some((_, link)) => {
                let _heard = said.send(Ok(link));
            }
            None => {
                lists.waiting.push_back((key, said));
                if lists.waiting.len() > Self::MOST {
                    lists.waiting.pop_front();
                }
            }
        }
        met
    }

    pub(crate) fn came(&self, key: SessionKey, link: Link) {
        let mut lists = self.0.lock();
        let waiting = lists.waiting.iter().position(|(waiting, _)| *waiting == key);
        match waiting.and_then(|place| lists.waiting.remove(place)) {
            Some((_, said)) => {
                let _unwanted = said.send(Ok(link));
            }
            None => {
                lists.early.push_back((key, link));
                if lists.early.len() > Self::MOST {
                    lists.early.pop_front();
                }
            }
        }
    }
}
