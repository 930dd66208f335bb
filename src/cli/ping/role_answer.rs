//! A role of a session that answers a ping: it sends back nothing, but says what it is.

use std::{fmt, time::Duration};

use serde::Serialize;
use trimaran_proto::{RejectionCode, Role, SceneOutline};
use trimaran_transport::{ConnectError, Endpoint, Refusal};

use super::tally::microseconds;

/// A role's words in a handshake.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct RoleAnswer {
    endpoint: String,
    /// The role; none if it says only that it knows this machine's key.
    role: Option<Role>,
    /// The fingerprint of its scene, if it tells one.
    scene: Option<String>,
    /// The role that it knows this machine's key for, if that is no display's.
    key_of: Option<String>,
    handshake_us: f64,
}

impl RoleAnswer {
    pub(super) fn new(
        at: &Endpoint,
        role: Option<Role>,
        scene: Option<SceneOutline>,
        handshake: Duration,
    ) -> Self {
        let scene = scene.map(|scene| scene.hash.to_string());
        Self { endpoint: at.to_string(), role, scene, key_of: None, handshake_us: microseconds(handshake) }
    }

    /// The answer in a refusal, if only a role refuses like that.
    pub(super) fn of_refusal(at: &Endpoint, error: &ConnectError, handshake: Duration) -> Option<Self> {
        match error.refusal()? {
            // A ping introduces itself as a display.
            Refusal::Rejected(why) if RejectionCode::Role.is_of(why) => {
                Some(Self::new(at, Some(Role::Display), None, handshake))
            }
            Refusal::Key { known, .. } => {
                Some(Self { key_of: Some(known.to_string()), ..Self::new(at, None, None, handshake) })
            }
            _ => None,
        }
    }
}

impl fmt::Display for RoleAnswer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { endpoint, role, scene, key_of, handshake_us } = self;
        let role = role.map_or_else(|| "role".to_owned(), |role| role.to_string());
        write!(f, "{endpoint}: a {role} answers in {handshake_us:.0} us")?;
        if let Some(scene) = scene {
            write!(f, ", with scene {scene}")?;
        }
        if let Some(known) = key_of {
            write!(f, ", and knows this machine's key as that of a {known}")?;
        }
        f.write_str("; for round trips run `trimaran ping --answer` on another port there")
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::SceneHash;

    use super::*;

    #[test]
    fn a_person_reads_what_answers() {
        let at = "tcp://one:7400".parse().unwrap();
        let scene = Some(SceneHash(0xab).into());
        let culler = RoleAnswer::new(&at, Some(Role::Culler), scene, Duration::from_micros(812));
        let said = culler.to_string();
        assert!(said.starts_with("tcp://one:7400: a culler answers in 812 us, with scene 0000"), "{said}");
        assert!(said.contains("00ab; for round trips"), "{said}");
        let keys = RoleAnswer { key_of: Some("culler".to_owned()), role: None, scene: None, ..culler };
        let said = keys.to_string();
        assert!(
            said.contains("a role answers in 812 us, and knows this machine's key as that of a culler;"),
            "{said}"
        );
    }
}
