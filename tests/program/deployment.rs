//! `trimaran deployment`: the files of a display and its cullers.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use confique::Layer;
use trimaran::config::{CullerConfig, DisplayConfig, RoleConfig};
use trimaran_transport::{Endpoints, keys::Keys};

use crate::common::program::{Bench, said};

const HOSTS: [&str; 3] = ["one", "10.0.0.2", "show"];

fn made(bench: &Bench, more: &[&str]) -> std::process::Output {
    bench.trimaran(&[&["deployment", "plant.scene"], more].concat())
}

fn listing(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn names(paths: &[PathBuf]) -> Vec<&str> {
    paths.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect()
}

fn read<C: RoleConfig>(folder: &Path, file: &str) -> C {
    C::load(Layer::empty(), &[], Some(&folder.join(file))).unwrap().0
}

fn shown(endpoints: &Option<Endpoints>) -> Vec<String> {
    endpoints.iter().flat_map(Endpoints::iter).map(ToString::to_string).collect()
}

#[test]
fn each_machine_gets_its_own_private_keys_and_knows_the_others() {
    let bench = Bench::with_plant(30);
    let output = made(&bench, &["--display", "show", "--cullers", "one,10.0.0.2", "--out", "a/trio"]);
    let printed = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let trio = bench.path("a/trio");
    assert_eq!(
        (listing(&bench.path("a")), listing(&trio)),
        (vec!["trio".to_owned()], {
            let mut hosts = HOSTS.map(str::to_owned).to_vec();
            hosts.sort();
            hosts
        })
    );
    assert_eq!(trio.metadata().unwrap().permissions().mode() & 0o777, 0o700, "it has private keys");
    for host in HOSTS {
        assert!(printed.contains(&format!("a/trio/{host} ")), "{printed}");
        let folder = trio.join(host);
        let role = if host == "show" { "display" } else { host };
        let mut files =
            [format!("{host}.key"), format!("{role}.toml"), "install.sh".into(), "plant.scene".into()]
                .to_vec();
        files.extend(HOSTS.map(|host| format!("{host}.pub")));
        files.sort();
        assert_eq!(listing(&folder), files, "{host}");
        let own = Keys::read(&folder.join(format!("{host}.key"))).unwrap();
        assert_eq!(own.public().name.as_str(), host);
        // The same public keys everywhere.
        for peer in HOSTS {
            let [here, there] = [host, peer].map(|at| fs::read(trio.join(at).join(format!("{peer}.pub"))));
            assert_eq!(here.unwrap(), there.unwrap(), "{peer} at {host}");
        }
        assert_eq!(
            fs::read(folder.join("plant.scene")).unwrap(),
            fs::read(bench.path("plant.scene")).unwrap()
        );
    }
    let display: DisplayConfig = read(&trio.join("show"), "display.toml");
    assert_eq!(shown(&display.cullers), ["quic://one:7400", "quic://10.0.0.2:7400"]);
    assert_eq!(names(&display.peers.cullers), ["one.pub", "10.0.0.2.pub"]);
    assert_eq!(display.common.keys.unwrap(), Path::new("/run/credentials/trimaran-display.service/keys"));
    assert_eq!(display.out, Path::new("/var/lib/trimaran/walk"));
    let culler: CullerConfig = read(&trio.join("one"), "one.toml");
    assert_eq!(shown(&culler.listen), ["quic://0.0.0.0:7400"]);
    assert_eq!(shown(&culler.cullers), ["quic://10.0.0.2:7400"]);
    assert_eq!(
        (names(&culler.peers.displays), names(&culler.peers.cullers)),
        (vec!["show.pub"], vec!["10.0.0.2.pub"])
    );
    assert_eq!(culler.common.keys.unwrap(), Path::new("/run/credentials/trimaran-culler@one.service/keys"));
    assert_eq!(culler.scene, trio.join("one/plant.scene"));
    let script = fs::read_to_string(trio.join("10.0.0.2/install.sh")).unwrap();
    assert!(script.contains("systemctl restart trimaran-culler@10.0.0.2\n"), "{script}");
}

#[test]
fn a_wrong_deployment_is_refused_and_leaves_nothing() {
    let bench = Bench::with_plant(30);
    fs::create_dir(bench.path("there")).unwrap();
    bench.write("no.scene", "x");
    let nine = (0..9).map(|number| format!("c{number}")).collect::<Vec<_>>().join(",");
    for (more, words) in [
        (&["--display", "one", "--cullers", "one"][..], "one is given twice"),
        (&["--display", "show", "--cullers", "one,one"], "one is given twice"),
        (&["--display", "show", "--cullers", ".."], ".. is no host"),
        (&["--display", "show", "--cullers", &nine], "9 cullers are too many"),
        (&["--display", "show", "--cullers", "a b"], "letters, digits"),
        (&["--display", "show", "--cullers", "one", "--out", "there"], "there is there already"),
    ] {
        let output = made(&bench, more);
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        assert!(said(&output).contains(words), "{more:?}: {}", said(&output));
    }
    let output = bench.trimaran(&["deployment", "no.scene", "--display", "show", "--cullers", "one"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("no.scene"), "{}", said(&output));
    assert_eq!(listing(&bench.path("")), ["no.scene", "plant.scene", "there"]);
    assert_eq!(listing(&bench.path("there")), [""; 0]);
}
