//! The Debian package, from its installation to its end.
//!
//! `TRIMARAN_DEB` names one that `./x deb` built. Otherwise it is packed as Cargo.toml says, with the tested
//! program, since a release build would take minutes.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::common::program::printed;
use crate::deployment::{CHECKOUT, DISPLAY, ONE, Over, TWO, Walk, commands_of_the_page};
use crate::machine::Machine;
use crate::walks;

/// The package, which is made once.
pub(crate) fn package() -> &'static Path {
    static PACKAGE: OnceLock<PathBuf> = OnceLock::new();
    PACKAGE.get_or_init(|| env::var_os("TRIMARAN_DEB").map_or_else(pack, PathBuf::from))
}

fn pack() -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = Path::new(env!("CARGO_BIN_EXE_trimaran"));
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("deb");
    if folder.exists() {
        fs::remove_dir_all(&folder).unwrap();
    }
    let (root, made) = (folder.join("root"), folder.join("package"));
    printed(&Command::new(program).arg("man").arg(made.join("man")).output().unwrap());
    for shell in ["bash", "fish", "zsh"] {
        let completions = Command::new(program).args(["completions", shell]).output().unwrap();
        fs::write(made.join(format!("trimaran.{shell}")), printed(&completions)).unwrap();
    }
    fs::write(made.join("notices.gz"), "").unwrap();

    let manifest: toml::Table = fs::read_to_string(source.join("Cargo.toml")).unwrap().parse().unwrap();
    let package = &manifest["package"];
    let deb = &package["metadata"]["deb"];
    let shell = |folder: &Path, line: &str| {
        let mut command = Command::new("sh");
        command.args(["-euc", line]).current_dir(folder).env("root", &root);
        printed(&command.output().unwrap()).trim_end().to_owned()
    };
    for asset in deb["assets"].as_array().unwrap() {
        let [from, to, mode] = [0_usize, 1, 2].map(|field| asset[field].as_str().unwrap());
        let (folder, from) = match from.strip_prefix("target/release/") {
            Some(built @ "trimaran") => (program.parent().unwrap(), built),
            Some(made) => (&*folder, made),
            None => (source, from),
        };
        let paths = if to.ends_with('/') {
            format!("-t \"$root/{to}\" {from}")
        } else {
            format!("-T {from} \"$root/{to}\"")
        };
        shell(folder, &format!("install -D -m {mode} {paths}"));
    }
    let scripts = source.join(deb["maintainer-scripts"].as_str().unwrap());
    shell(&scripts, "install -D -m 755 -t \"$root/DEBIAN\" postinst prerm postrm");
    let conffiles = deb["conf-files"].as_array().unwrap().iter().map(|path| path.as_str().unwrap());
    let conffiles: String = conffiles.map(|path| format!("{path}\n")).collect();
    fs::write(root.join("DEBIAN/conffiles"), conffiles).unwrap();
    let [maintainer, depends, recommends] =
        ["maintainer", "depends", "recommends"].map(|key| deb[key].as_str().unwrap());
    let control = format!(
        "Package: trimaran\nVersion: 0.1.0-1\nArchitecture: {}\nMaintainer: {maintainer}\nDepends: {}\n\
         Recommends: {recommends}\nDescription: {}\n",
        shell(&folder, "dpkg --print-architecture"),
        depends.strip_prefix("$auto, ").unwrap(),
        package["description"].as_str().unwrap(),
    );
    fs::write(root.join("DEBIAN/control"), control).unwrap();
    shell(&folder, "dpkg-deb --root-owner-group -Znone --build \"$root\" trimaran_0.1.0-1.deb");
    folder.join("trimaran_0.1.0-1.deb")
}

/// Idle stand-ins for other services: the relay never gets ready, so an upgrade must not wait for it.
const IDLE: [(&str, &str); 2] = [("trimaran-relay@idle", "notify"), ("trimaran-serve@idle", "exec")];

fn start_idle_services(machine: &Machine) {
    for (service, kind) in IDLE {
        let folder = format!("/etc/systemd/system/{service}.service.d");
        let section =
            format!("[Service]\nType={kind}\nWatchdogSec=0\nExecStart=\nExecStart=sleep infinity\n");
        machine.run(&format!("mkdir {folder}"));
        fs::write(machine.path(&format!("{folder}/idle.conf")), section).unwrap();
        machine.run(&format!("systemctl daemon-reload; systemctl start --no-block {service}"));
        machine.wait_for_another_process(service, "0");
    }
}

#[test]
fn the_package_is_upgraded_during_a_walk_removed_and_purged() {
    let walk = Walk::endless();
    let Some(machine) = Machine::boot("package") else { return };
    walk.install(&machine, Over::Quic);
    start_idle_services(&machine);
    machine.run("echo TRIMARAN_LOG_FORMAT=json >> /etc/default/trimaran");
    [ONE, TWO, DISPLAY].into_iter().for_each(|service| walks(&machine, service));

    let restarted = [ONE.0, TWO.0, IDLE[0].0, IDLE[1].0];
    let before = restarted.map(|service| machine.main_process(service));
    let display = machine.main_process(DISPLAY.0);
    machine.run(&format!(
        "cd /run; dpkg-deb -R {CHECKOUT}/trimaran_*.deb next
         sed -i 's/^Version: .*/Version: 9-1/' next/DEBIAN/control
         dpkg-deb -Znone --build next; apt-get install -y ./next.deb"
    ));
    assert_eq!(machine.run("dpkg-query -W -f '${Version}' trimaran"), "9-1");
    for (service, before) in restarted.into_iter().zip(&before) {
        machine.wait_for_another_process(service, before);
    }
    [ONE, TWO].into_iter().for_each(|service| walks(&machine, service));
    assert_eq!(machine.main_process(DISPLAY.0), display);
    assert_eq!(machine.run("tail -n 1 /etc/default/trimaran"), "TRIMARAN_LOG_FORMAT=json");
    walk.is_stopped(&machine);
    machine.run("systemctl start trimaran-display");

    let backup = commands_of_the_page("Backup");
    let [save, restore @ ..] = &backup[..] else { panic!("{backup:?}") };
    assert_eq!(restore.len(), 3, "{backup:?}");
    let on_one = |(host, command): &(String, String)| {
        assert_eq!(host, "one");
        machine.run(&format!("cd /run/home/one; {command}"));
    };
    on_one(save);
    assert_eq!(machine.run("stat --format %a /run/home/one/one.tar"), "600");

    let is_there = |path: &str| machine.path(path).symlink_metadata().is_ok();
    let wanted = "/etc/systemd/system/multi-user.target.wants/trimaran-culler@one.service";
    machine.run("apt-get remove -y trimaran");
    let running = "systemctl list-units --no-legend --state active,activating 'trimaran-*.service'";
    assert_eq!(machine.run(running), "");
    for path in ["/usr/bin/trimaran", "/usr/lib/systemd/system/trimaran-culler@.service"] {
        assert!(!is_there(path), "{path}");
    }
    let removed_by_purge = ["/etc/default/trimaran", "/var/cache/trimaran", wanted];
    for path in removed_by_purge {
        assert!(is_there(path), "{path}");
    }
    machine.run("apt-get purge -y trimaran");
    for path in removed_by_purge {
        assert!(!is_there(path), "{path}");
    }
    for path in ["/etc/trimaran/one.toml", "/etc/credstore/trimaran-one.key", "/var/lib/trimaran/walk"] {
        assert!(is_there(path), "{path}");
    }
    // Where no systemd runs, as in a chroot.
    machine.run(
        "unshare --mount sh -euc 'mount -t tmpfs none /run/systemd; apt-get install -y /run/next.deb
         /usr/bin/trimaran --version; apt-get purge -y trimaran'",
    );

    let files = ["/etc/trimaran/plant.scene", "/etc/trimaran/one.toml", "/etc/credstore/trimaran-one.key"];
    let owned = |path: &str| machine.run(&format!("stat --format %a:%U:%G {path}"));
    let before = files.map(owned);
    assert_eq!(before, ["640:root:trimaran", "640:root:trimaran", "600:root:root"]);
    machine.run("rm -r /etc/trimaran /etc/credstore/trimaran-one.key");
    restore.iter().for_each(on_one);
    assert_eq!(files.map(owned), before);
    machine.run(&format!("systemctl start {}; systemctl start {}", TWO.0, DISPLAY.0));
    [ONE, TWO, DISPLAY].into_iter().for_each(|service| walks(&machine, service));
}
