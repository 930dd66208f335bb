//! Checks of a role's configuration: it is loaded, and its files and its device are opened, as the role does
//! at its start.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use trimaran::{
    config::{DisplayConfig, RoleName, RoleNeeds},
    walkthrough::{CameraPath, PathChoice, SceneFile},
};
use trimaran_gpu::{Gpu, GpuError, GpuInfo, GpuScene};
use trimaran_proto::SceneOutline;
use trimaran_scene::Scene;
use trimaran_transport::{Options, keys::Security};

use super::{
    Failure,
    finding::Finding,
    role::session_plan,
    walking::{self, role_gpu},
};

/// A configuration that was loaded.
pub(super) struct Loaded {
    pub(super) needs: Box<dyn RoleNeeds>,
    /// The options of its links, with its keys if these can be used.
    pub(super) options: Options,
}

/// Checks all that the role opens of this machine.
pub(super) fn check(file: &Path, role: Option<RoleName>) -> Vec<Finding> {
    let (mut findings, loaded) = load(file, role);
    if let Some(loaded) = loaded {
        findings.extend(open(&*loaded.needs).0);
    }
    findings
}

/// Loads the file, and the keys that it names. Without a role it is the role that has most of its keys.
pub(super) fn load(file: &Path, role: Option<RoleName>) -> (Vec<Finding>, Option<Loaded>) {
    let role = match role.map_or_else(|| RoleName::of_file(file), Ok) {
        Ok(role) => role,
        Err(error) => return (vec![Finding::wrong("file", Failure::bad_input(error))], None),
    };
    let name = role.name();
    let (needs, mut options) = match role.load(file) {
        Ok(loaded) => loaded,
        Err(error) => {
            // A message of TOML ends with a line break.
            let why = Failure::bad_input(error).to_string();
            let detail = format!("{} (read as a {name}'s: --role names another role)", why.trim_end());
            return (vec![Finding::wrong("file", detail)], None);
        }
    };
    let mut findings = vec![Finding::ok("file", format!("{} is a {name}'s", file.display()))];
    let keys = needs.common().keys.as_deref().map(private_keys);
    match needs.security_with(&options, keys.as_deref()) {
        Ok(None) => findings.push(Finding::ok("keys", "no endpoint needs any")),
        Ok(Some(security)) => {
            findings.push(Finding::ok("keys", known(&security)));
            options.security = Some(security);
        }
        Err(error) => findings.push(Finding::wrong("keys", Failure::bad_input(error))),
    }
    (findings, Some(Loaded { needs, options }))
}

fn known(Security { keys, peers }: &Security) -> String {
    let peers = peers.now();
    let names: Vec<_> = peers.iter().map(|peer| peer.keys.name.as_str()).collect();
    format!("this machine is {}, and knows {}", keys.public().name, names.join(", "))
}

/// The file of the private keys. systemd hands it to a service when that starts; before, it is where systemd
/// takes it from.
fn private_keys(named: &Path) -> PathBuf {
    match credential_source(named) {
        Some(source) if !named.exists() && source.exists() => source,
        _ => named.to_owned(),
    }
}

/// Where the units of this repository take a service's keys from.
fn credential_source(keys: &Path) -> Option<PathBuf> {
    let unit = keys.strip_prefix("/run/credentials").ok()?.iter().next()?.to_str()?;
    let unit = unit.strip_suffix(".service")?.strip_prefix("trimaran-")?;
    let name = unit.split_once('@').map_or(unit, |(_, instance)| instance);
    Some(format!("/etc/credstore/trimaran-{name}.key").into())
}

/// Opens scene, device and path.
pub(super) fn open(needs: &dyn RoleNeeds) -> (Vec<Finding>, Option<SceneFile>) {
    let mut findings = Vec::new();
    let mut opened = None;
    if let Some(path) = needs.scene() {
        match walking::scene(path) {
            Ok(file) => {
                let detail = format!("{}, fingerprint {}", path.display(), file.scene.hash());
                findings.push(Finding::ok("scene", detail));
                opened = Some(file);
            }
            Err(failure) => findings.push(Finding::failed("scene", &failure)),
        }
    }
    if let Some(config) = needs.gpu() {
        let scene = opened.as_ref().map(|file| &file.scene);
        let gpu = Gpu::open(&role_gpu(config));
        let drawn = gpu.and_then(|gpu| {
            scene.map(|scene| GpuScene::new(&gpu, scene)).transpose()?;
            Ok(gpu)
        });
        findings.push(match drawn {
            Ok(gpu) => Finding::ok("device", format!("opened {}", identified(gpu.info()))),
            Err(error @ GpuError::NoSuchDevice { .. }) => Finding::wrong("device", Failure::bad_input(error)),
            Err(error) => Finding::missing("device", Failure::broken(error)),
        });
    }
    if let Some(config) = needs.display() {
        findings.push(match walk(config, opened.as_ref()) {
            Ok(detail) => Finding::ok("walk", detail),
            Err(failure) => Finding::failed("walk", &failure),
        });
    }
    (findings, opened)
}

/// A device's name, UUID and PCI address.
fn identified(GpuInfo { name, uuid, pci, .. }: &GpuInfo) -> String {
    let pci = pci.map(|pci| format!(", PCI {pci}")).unwrap_or_default();
    format!("{name}, UUID {uuid}{pci}")
}

/// The settings, view states and path of a display's walk. An automatic path is not searched for: it takes
/// long.
fn walk(config: &DisplayConfig, file: Option<&SceneFile>) -> Result<String, Failure> {
    let plan = session_plan(config)?;
    let session = &config.session;
    let scene = file.map(|file| Arc::clone(&file.scene));
    let states = session.state.as_deref().filter(|_| scene.is_some());
    // Without the scene the names in view states are not known, and a path has another near plane.
    let scene = scene.unwrap_or_else(|| Arc::new(Scene::empty(SceneOutline::default())));
    let views = walking::view_states(states, &plan, &scene)?;
    let choice = PathChoice::parse(&session.path, session.seed);
    if let PathChoice::Auto { seed } = choice {
        return Ok(format!("an automatic path, seed {seed}"));
    }
    let path = CameraPath::find(&choice, &scene, views, session.frames).map_err(Failure::bad_input)?;
    Ok(format!("{}, {} frames", session.path, path.frames()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_before_systemd_hands_them_over() {
        for (keys, source) in [
            ("/run/credentials/trimaran-culler@one.service/keys", Some("/etc/credstore/trimaran-one.key")),
            ("/run/credentials/trimaran-display.service/keys", Some("/etc/credstore/trimaran-display.key")),
            ("/run/credentials/nginx.service/keys", None),
            ("/run/credentials", None),
            ("one.key", None),
        ] {
            assert_eq!(credential_source(Path::new(keys)), source.map(PathBuf::from), "{keys}");
        }
        assert_eq!(private_keys(Path::new("one.key")), Path::new("one.key"));
    }
}
