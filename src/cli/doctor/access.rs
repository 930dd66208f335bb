//! Whether the calling thread's user may open what a role needs.

use std::{
    fs::{self, File, OpenOptions},
    io,
    os::unix::fs::{MetadataExt, PermissionsExt},
    path::{Path, PathBuf},
};

use trimaran::config::RoleNeeds;

use crate::cli::finding::Finding;

/// Folders that systemd makes for a service when it starts.
const MADE_BY_SYSTEMD: [&str; 2] = ["/var/lib/trimaran", "/run/trimaran"];

/// Whether a path is below a folder that only systemd's start of the service makes.
pub(super) fn is_made_at_the_start(path: &Path) -> bool {
    MADE_BY_SYSTEMD.iter().any(|folder| path.starts_with(folder) && !Path::new(folder).exists())
}

/// The files that a role reads, and the folder that it writes. Its scene is opened elsewhere.
pub(super) fn files(config: &Path, needs: &dyn RoleNeeds, user: &str) -> Finding {
    let mut read = vec![config.to_owned()];
    read.extend(needs.known().iter().flat_map(|peers| peers.paths.iter().cloned()));
    // systemd reads others for the service.
    read.extend(needs.common().keys.clone().filter(|keys| !keys.starts_with("/run/credentials")));
    let display = needs.display();
    if let Some(display) = display {
        read.extend(display.session.state.clone());
        read.extend(Some(PathBuf::from(&display.session.path)).filter(|path| path.as_os_str() != "auto"));
    }
    let mut lines: Vec<_> = read.iter().filter_map(|path| unreadable(path, user)).collect();
    lines.extend(display.and_then(|display| unwritable(&display.out, user)));
    match lines.is_empty() {
        true => Finding::ok("access", format!("{user} may read the role's files")),
        false => Finding::missing("access", lines.join("; ")),
    }
}

fn unreadable(path: &Path, user: &str) -> Option<String> {
    let error = File::open(path).err()?;
    let forbidden = error.kind() == io::ErrorKind::PermissionDenied;
    forbidden.then(|| format!("{user} may not read {}{}", path.display(), owned(path)))
}

/// The folder may be missing yet: then a folder above it has to let the user write.
fn unwritable(folder: &Path, user: &str) -> Option<String> {
    let there = folder.ancestors().find(|folder| folder.is_dir() || folder.as_os_str().is_empty())?;
    let at = if there.as_os_str().is_empty() { Path::new(".") } else { there };
    let error = tempfile::tempfile_in(at).err().filter(|_| !is_made_at_the_start(folder))?;
    Some(format!("{user} cannot write {}: {error}{}", folder.display(), owned(at)))
}

/// Owner and mode, as far as they can be seen.
fn owned(path: &Path) -> String {
    let Ok(about) = fs::metadata(path) else { return " (a folder above it is closed)".to_owned() };
    let mode = about.permissions().mode() & 0o777;
    format!(" (mode {mode:03o}, owner {}, group {})", about.uid(), group(about.gid()))
}

/// The name of a group, or its number.
fn group(gid: u32) -> String {
    let name = nix::unistd::Group::from_gid(gid.into()).ok().flatten().map(|group| group.name);
    name.unwrap_or_else(|| gid.to_string())
}

/// The device files of graphics cards in the folder `dev`.
pub(super) fn devices(dev: &Path, user: &str) -> Finding {
    let nodes = nodes(dev);
    if nodes.is_empty() {
        return Finding::ok("nodes", "no files of graphics cards in /dev: drivers draw on the CPU");
    }
    let forbidden: Vec<_> = nodes.iter().filter_map(|node| locked(node, user)).collect();
    if forbidden.len() == nodes.len() {
        return Finding::missing("nodes", forbidden.join("; "));
    }
    let open = nodes.len() - forbidden.len();
    Finding::ok("nodes", format!("{user} may open {open} of {} files of graphics cards", nodes.len()))
        .lacking(forbidden)
}

/// `dri/renderD*`, `nvidia0` and the like, and `nvidiactl`, which all of NVIDIA's need.
fn nodes(dev: &Path) -> Vec<PathBuf> {
    let is_nvidia = |name: &str| {
        let rest = name.strip_prefix("nvidia");
        rest.is_some_and(|rest| rest == "ctl" || !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_digit()))
    };
    let is_render = |name: &str| name.starts_with("renderD");
    let within = |folder: PathBuf, is_node: &dyn Fn(&str) -> bool| -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let nodes = entries.filter(|entry| entry.file_name().to_str().is_some_and(is_node));
        nodes.map(|entry| entry.path()).collect()
    };
    let mut nodes = within(dev.join("dri"), &is_render);
    nodes.extend(within(dev.to_owned(), &is_nvidia));
    nodes.sort_unstable();
    nodes
}

/// Why the user may not open a device file, and the remedy.
fn locked(node: &Path, user: &str) -> Option<String> {
    let error = OpenOptions::new().read(true).write(true).open(node).err()?;
    if error.kind() != io::ErrorKind::PermissionDenied {
        return None;
    }
    let (mode, gid) = fs::metadata(node).map(|about| (about.mode(), about.gid())).unwrap_or_default();
    let remedy = if mode & 0o006 == 0o006 {
        "its container or control group has to grant it".to_owned()
    } else if mode & 0o060 == 0o060 && gid != 0 {
        format!("usermod -aG {} {user}", group(gid))
    } else {
        "a rule of udev has to let a group of this user open it".to_owned()
    };
    Some(format!("{user} may not open {}{}: {remedy}", node.display(), owned(node)))
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use std::fs::Permissions;

    use super::{super::service_user::ServiceUser, *};

    /// Folders with files of these modes, open to all, and the user that looks at them.
    fn dev(modes: &[(&str, u32)]) -> (tempfile::TempDir, Option<ServiceUser>) {
        let dev = tempfile::tempdir().unwrap();
        fs::create_dir(dev.path().join("dri")).unwrap();
        for folder in [dev.path(), &dev.path().join("dri")] {
            fs::set_permissions(folder, Permissions::from_mode(0o755)).unwrap();
        }
        for (name, mode) in modes {
            fs::write(dev.path().join(name), "").unwrap();
            fs::set_permissions(dev.path().join(name), Permissions::from_mode(*mode)).unwrap();
        }
        // Root may open anything.
        let is_root = rustix::process::geteuid().is_root();
        (dev, ServiceUser::find(Some("nobody").filter(|_| is_root)).unwrap())
    }

    fn found(dev: &Path, user: Option<&ServiceUser>) -> serde_json::Value {
        let look = || devices(dev, "nobody");
        let finding = user.map_or_else(look, |user| user.run(look).unwrap());
        serde_json::to_value(finding).unwrap()
    }

    #[test]
    fn a_card_that_the_user_may_not_open_is_named_with_its_mode() {
        let (dev, user) = dev(&[("dri/renderD128", 0o000), ("dri/card0", 0o666), ("nvidia-uvm", 0o666)]);
        let finding = found(dev.path(), user.as_ref());
        let detail = finding["detail"].as_str().unwrap();
        assert!(
            detail.starts_with("nobody may not open /") && detail.contains("renderD128 (mode 000"),
            "{detail}"
        );
        assert_eq!(finding["works"], false);
    }

    #[test]
    fn one_card_that_may_be_opened_is_enough() {
        let (dev, user) = dev(&[("nvidia0", 0o666), ("nvidiactl", 0o666), ("dri/renderD128", 0o000)]);
        let finding = found(dev.path(), user.as_ref());
        assert_eq!(finding["works"], true);
        assert!(finding["detail"].as_str().unwrap().contains("2 of 3"), "{finding}");
        assert!(finding["lacks"][0].as_str().unwrap().contains("renderD128"), "{finding}");
        let (none, user) = self::dev(&[]);
        assert_eq!(found(none.path(), user.as_ref())["works"], true);
    }

    #[test]
    fn a_thread_of_the_users_leaves_the_rest_of_the_process_alone() {
        let (dev, Some(user)) = dev(&[("secret", 0o600)]) else { return };
        let secret = dev.path().join("secret");
        let said = user.run(|| unreadable(&secret, "nobody")).unwrap().unwrap();
        assert!(said.contains("nobody may not read") && said.contains("mode 600"), "{said}");
        assert_eq!(unreadable(&secret, "root"), None);
        assert!(unwritable(&dev.path().join("new/walk"), "root").is_none());
        let said = user.run(|| unwritable(&dev.path().join("new/walk"), "nobody")).unwrap().unwrap();
        assert!(said.contains("nobody cannot write") && said.contains("mode 755"), "{said}");
    }
}
