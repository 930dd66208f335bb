//! A role's deployment on this machine: its configuration, its files, its ports, its peers.

use std::{path::Path, sync::Arc, time::Duration};

use tokio::runtime::Builder;
use trimaran::config::RoleNeeds;
use trimaran_transport::{Endpoint, Endpoints, Net, Options, TokioNet};

use super::{access, network::Deployed, service_user::ServiceUser};
use crate::cli::{
    Failure,
    args::DoctorArgs,
    finding::Finding,
    role_check::{self, Loaded},
};

/// Checks the configuration in `file`, and this machine for it.
///
/// # Errors
/// If the checks cannot be made as the service's user.
pub(super) fn check(file: &Path, args: &DoctorArgs) -> Result<Vec<Finding>, Failure> {
    let user = ServiceUser::find(args.user.as_deref())?;
    // Private keys may be root's: systemd hands them to the service.
    let (mut findings, loaded) = role_check::load(file, args.role);
    if let Some(loaded) = loaded {
        let timeout = Duration::try_from_secs_f64(args.timeout).unwrap_or(Duration::MAX);
        let name = user.as_ref().map_or("this user", ServiceUser::name);
        let found = || as_its_user(file, &loaded, name, timeout);
        findings.extend(match &user {
            Some(user) => user.run(found)??,
            None => found()?,
        });
    }
    Ok(findings)
}

/// The checks with the permissions of the calling thread's user.
fn as_its_user(file: &Path, loaded: &Loaded, user: &str, timeout: Duration) -> Result<Vec<Finding>, Failure> {
    let Loaded { needs, options } = loaded;
    let mut findings = vec![access::files(file, &**needs, user)];
    if needs.gpu().is_some() {
        findings.push(access::devices(Path::new("/dev"), user));
    }
    let (opened, scene) = role_check::open(&**needs);
    findings.extend(opened);
    findings.push(descriptors(&**needs, options));
    let runtime = Builder::new_current_thread().enable_all().build().map_err(Failure::broken)?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let scene = scene.map(|file| file.scene.outline());
    findings.extend(runtime.block_on(Deployed { net: &net, loaded, scene, timeout }.check()));
    Ok(findings)
}

/// The files that a role has open beside its peers' links: generously, those of its device, its scene, its
/// log and its metrics.
const OWN_FILES: usize = 64;

/// Whether as many peers may come as `limits` allows: each link over byte streams has a file for each lane.
fn descriptors(needs: &dyn RoleNeeds, options: &Options) -> Finding {
    let is_of_streams = |at: &Endpoint| !matches!(at, Endpoint::Udp(_) | Endpoint::Quic(_));
    let streams = |endpoints: &Endpoints| endpoints.iter().filter(|at| is_of_streams(at)).count();
    let listens = needs.listen().map_or(0, streams) > 0;
    let sought: usize = needs.sought().iter().map(|peers| streams(peers.endpoints)).sum();
    let peers = sought + if listens { options.limits.peers } else { 0 };
    let handshakes = if listens { options.limits.handshakes } else { 0 };
    let needed = OWN_FILES.saturating_add(handshakes).saturating_add(peers.saturating_mul(FILES_OF_A_LINK));
    enough(needed, open_files(), options.limits.peers)
}

/// A link over byte streams has one for each of its lanes: latest, frames, messages and bulk.
const FILES_OF_A_LINK: usize = 4;

fn enough(needed: usize, limit: Option<u64>, peers: usize) -> Finding {
    match limit {
        Some(limit) if limit < needed as u64 => {
            let detail = format!(
                "{limit} files may be open, and {peers} peers take up to {needed}: raise the limit (ulimit -n; \
                 LimitNOFILE= of the service), or lower limits.peers"
            );
            Finding::missing("limits", detail)
        }
        Some(limit) => {
            Finding::ok("limits", format!("{limit} files may be open, and up to {needed} are needed"))
        }
        None => Finding::ok("limits", "any number of files may be open"),
    }
}

/// How many files a process may have open; `None` for any number.
#[cfg(target_os = "linux")]
fn open_files() -> Option<u64> {
    rustix::process::getrlimit(rustix::process::Resource::Nofile).current
}

#[cfg(not(target_os = "linux"))]
const fn open_files() -> Option<u64> {
    None
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use trimaran::config::RoleName;

    use super::*;

    #[test]
    fn more_peers_than_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let needed = |text: &str| {
            let file = folder.path().join("role.toml");
            std::fs::write(&file, text).unwrap();
            let (needs, options) = RoleName::Relay.load(&file).unwrap();
            let finding = serde_json::to_value(descriptors(&*needs, &options)).unwrap();
            let detail = finding["detail"].as_str().unwrap().to_owned();
            let number = detail.split_whitespace().rev().find_map(|word| word.trim_matches(':').parse().ok());
            (finding["works"] == true, number.unwrap_or(0_u64))
        };
        let over = |listen: &str, peers: u32| {
            format!("upstream = 'tcp://x:1'\nlisten = '{listen}'\nlimits.peers = {peers}\n")
        };
        assert_eq!(needed(&over("udp://y:1", 100)).1, 64 + 4);
        assert_eq!(needed(&over("tcp://y:1", 100)).1, 64 + 4 + 64 + 400);
        let (works, _) = needed(&over("tcp://y:1", 1_000_000_000));
        assert!(!works || open_files().is_none());
        let short = serde_json::to_value(enough(1025, Some(1024), 240)).unwrap();
        assert_eq!(short["works"], false);
        assert!(short["detail"].as_str().unwrap().contains("240 peers take up to 1025"), "{short}");
    }
}
