//! A role's ports and peers: it listens as the role would, and shakes hands with each peer.

use std::{
    io,
    net::{SocketAddr, TcpListener},
    path::Path,
    sync::Arc,
    time::Duration,
};

use futures_util::future::join_all;
use trimaran::config::{SoughtPeers, needs_keys};
use trimaran_actors::Listener;
use trimaran_proto::{CloseCode, Identity, RejectionCode, Role, SceneOutline, Walkthrough};
use trimaran_transport::{
    AttemptError, ConnectError, Endpoint, Endpoints, HandshakeError, ListenError, Net, Options, Refusal,
    causes, connect_once, until,
};

use super::access::is_made_at_the_start;
use crate::cli::{finding::Finding, role_check::Loaded};

/// How long a peer may take to hear that a check is over.
const HEARD: Duration = Duration::from_millis(200);

/// The role that is checked, with its scene.
pub(super) struct Deployed<'d> {
    pub(super) net: &'d Arc<dyn Net>,
    pub(super) loaded: &'d Loaded,
    pub(super) scene: Option<SceneOutline>,
    /// How long to wait for an answer.
    pub(super) timeout: Duration,
}

impl Deployed<'_> {
    /// Each port, then each peer. Those that need keys are left out if there are none: that is said already.
    pub(super) async fn check(&self) -> Vec<Finding> {
        let needs = &self.loaded.needs;
        let mut findings = Vec::new();
        for endpoint in needs.listen().into_iter().flat_map(Endpoints::iter).filter(|at| self.has_keys(at)) {
            findings.push(self.port(endpoint).await);
        }
        findings.extend(needs.common().metrics.map(metrics));
        let sought = needs.sought();
        let peers = sought.iter().flat_map(|peers| peers.endpoints.iter().map(move |at| (peers, at)));
        let peers = peers.filter(|(_, at)| self.has_keys(at)).map(|(peers, at)| self.peer(peers, at));
        findings.extend(join_all(peers).await);
        findings
    }

    fn options(&self) -> &Options {
        &self.loaded.options
    }

    fn has_keys(&self, at: &Endpoint) -> bool {
        self.options().security.is_some() || !needs_keys(self.options(), at)
    }

    /// Listens there for a moment.
    async fn port(&self, at: &Endpoint) -> Finding {
        if let Endpoint::Unix(path) = at
            && is_made_at_the_start(path.as_path())
        {
            let folder = path.as_path().parent().unwrap_or(Path::new("/"));
            return Finding::ok("port", format!("{at}: systemd makes {} at the start", folder.display()));
        }
        let identity = self.identity(self.loaded.needs.role());
        match Listener::bind(self.net, at, identity, self.options()).await {
            Ok(listener) => {
                listener.close().await;
                Finding::ok("port", format!("can listen on {at}"))
            }
            Err(error @ ListenError::InUse { .. }) => {
                Finding::missing("port", format!("{error}; it may be this very service, if that runs"))
            }
            Err(error) if error.may_pass() => Finding::missing("port", causes(&error)),
            Err(error) => Finding::wrong("port", causes(&error)),
        }
    }

    fn identity(&self, role: Role) -> Identity {
        Identity { role, scene: self.scene, session: None }
    }

    /// Shakes hands with the peer there, and begins nothing with it.
    async fn peer(&self, peers: &SoughtPeers<'_>, at: &Endpoint) -> Finding {
        let own = self.loaded.needs.role();
        // A display takes a culler into its walk, and refuses a display.
        let claimed = if (own, peers.role) == (Role::Culler, Role::Culler) { own } else { Role::Display };
        let by = self.net.now().after(self.timeout);
        let made =
            connect_once::<Walkthrough>(self.net, at, self.identity(claimed), self.options(), by).await;
        let answered = match made {
            Ok(link) => {
                let Identity { role, scene, .. } = link.peer.hello;
                let heard = self.net.now().after(HEARD);
                let _unheard = until(&**self.net, heard, link.close(CloseCode::Finished.reason())).await;
                Ok((role, scene.is_some() && self.scene.is_some()))
            }
            Err(error) => match error.refusal() {
                // Scenes were compared before roles, and a culler always has one.
                Some(Refusal::Rejected(why)) if RejectionCode::Role.is_of(why) => {
                    Ok((claimed, claimed == Role::Culler && self.scene.is_some()))
                }
                Some(Refusal::Key { known, .. }) if known.as_str() == own.to_string() => {
                    Ok((peers.role, false))
                }
                _ => Err(error),
            },
        };
        judged(peers, at, answered, self.timeout)
    }
}

/// Listens for a moment where the metrics are to be shown.
fn metrics(at: SocketAddr) -> Finding {
    match TcpListener::bind(at) {
        Ok(_) => Finding::ok("port", format!("can listen on {at}, for metrics")),
        Err(error) => Finding::missing("port", format!("cannot listen on {at}, for metrics: {error}")),
    }
}

/// The finding about a peer: the role that answers and whether it has compared scenes, or no such answer.
fn judged(
    SoughtPeers { key, role: due, .. }: &SoughtPeers<'_>,
    at: &Endpoint,
    answered: Result<(Role, bool), ConnectError>,
    timeout: Duration,
) -> Finding {
    match answered {
        Ok((role, same_scene)) if role == *due || (role, *due) == (Role::Relay, Role::Culler) => {
            let scene = if same_scene { ", which has the same scene" } else { "" };
            Finding::ok("peer", format!("{key}: {at} is a {role}{scene}"))
        }
        Ok((role, _)) => {
            let detail = format!("{key}: a {role} is at {at}, where a {due} was due: correct the endpoint");
            Finding::wrong("peer", detail)
        }
        Err(ConnectError::Deadline { last, .. }) => {
            Finding::missing("peer", format!("{key}: {at}: {}", explained(&last, at, timeout)))
        }
        Err(error) if error.may_pass() => Finding::missing("peer", causes(&error)),
        Err(error) => Finding::wrong("peer", causes(&error)),
    }
}

/// Why there was no handshake, and the remedy.
fn explained(error: &AttemptError, at: &Endpoint, timeout: Duration) -> String {
    let remedy = match error {
        AttemptError::Resolve(_) | AttemptError::NoAddress => {
            "check the name, /etc/hosts and the name server"
        }
        AttemptError::Connect { cause, .. } => match cause.kind() {
            io::ErrorKind::ConnectionRefused | io::ErrorKind::NotFound => {
                "nothing listens there: start that role, or correct the endpoint"
            }
            io::ErrorKind::TimedOut | io::ErrorKind::HostUnreachable | io::ErrorKind::NetworkUnreachable => {
                return silent(at, timeout);
            }
            _ => "",
        },
        AttemptError::TimedOut
        | AttemptError::Handshake { cause: HandshakeError::TimedOut | HandshakeError::Unanswered, .. } => {
            return silent(at, timeout);
        }
        _ => "",
    };
    let why = causes(error);
    if remedy.is_empty() { why } else { format!("{why}: {remedy}") }
}

/// Likely causes of silence.
fn silent(at: &Endpoint, timeout: Duration) -> String {
    let may_be = match at.transport() {
        "udp" => {
            "a firewall drops UDP on the way, nothing listens there, or it does not know this machine's keys"
        }
        "quic" => "a firewall drops UDP on the way, or nothing listens there",
        "unix" => "the process that has it hangs",
        _ => "a firewall drops TCP on the way, or the machine or the role there hangs",
    };
    format!("no answer within {timeout:?}: {may_be}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(at: &str, answered: Result<(Role, bool), ConnectError>) -> serde_json::Value {
        let endpoints: Endpoints = at.parse().unwrap();
        let peers = SoughtPeers { key: "cullers", role: Role::Culler, endpoints: &endpoints };
        let finding = judged(&peers, endpoints.first(), answered, Duration::from_secs(5));
        serde_json::to_value(finding).unwrap()
    }

    fn failed(at: &str, last: AttemptError) -> serde_json::Value {
        let endpoint = at.parse().unwrap();
        line(at, Err(ConnectError::Deadline { endpoint, waited: Duration::ZERO, attempts: 1, last }))
    }

    #[test]
    fn a_relay_stands_for_a_culler_and_a_display_does_not() {
        for (role, works, words) in [
            (Role::Culler, true, "is a culler, which has the same scene"),
            (Role::Relay, true, "is a relay"),
            (Role::Display, false, "a display is at tcp://one:7400, where a culler was due"),
        ] {
            let finding = line("tcp://one:7400", Ok((role, true)));
            assert_eq!((&finding["works"], &finding["must_correct"]), (&works.into(), &(!works).into()));
            assert!(finding["detail"].as_str().unwrap().contains(words), "{finding}");
        }
    }

    #[test]
    fn silence_a_closed_port_and_a_wrong_name_are_told_apart() {
        let connect = |kind: io::ErrorKind| AttemptError::Connect {
            address: "one:7400".to_owned(),
            cause: kind.into(),
        };
        let unanswered =
            || AttemptError::Handshake { address: "one:7400".to_owned(), cause: HandshakeError::Unanswered };
        for (at, last, words) in [
            ("tcp://one:7400", AttemptError::TimedOut, "no answer within 5s: a firewall drops TCP"),
            ("tcp://one:7400", connect(io::ErrorKind::HostUnreachable), "a firewall drops TCP"),
            ("udp://one:7400", unanswered(), "a firewall drops UDP"),
            ("udp://one:7400", unanswered(), "does not know this machine's keys"),
            ("tcp://one:7400", connect(io::ErrorKind::ConnectionRefused), "nothing listens there: start"),
            ("tcp://oen:7400", AttemptError::NoAddress, "check the name"),
        ] {
            let finding = failed(at, last);
            let detail = finding["detail"].as_str().unwrap();
            assert!(detail.starts_with(&format!("cullers: {at}: ")) && detail.contains(words), "{detail}");
            assert_eq!(finding["must_correct"], false);
        }
    }
}
