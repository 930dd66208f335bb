//! The configurations in `examples/configs`, from which docs/operations.md tells people to start.

use std::path::{Path, PathBuf};

use confique::{Config, Layer};
use trimaran::config::{CullerConfig, DisplayConfig, RelayConfig, RoleConfig, SessionConfig, WatcherConfig};
use trimaran_transport::{Endpoint, Endpoints};

fn example<C: RoleConfig>(name: &str) -> C {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/configs").join(name);
    C::load(Layer::empty(), &[], Some(&path)).unwrap().0
}

fn each(endpoints: &Option<Endpoints>) -> Vec<&Endpoint> {
    endpoints.iter().flat_map(Endpoints::iter).collect()
}

#[test]
fn the_example_display_finds_cullers_where_these_listen() {
    let (display, culler) =
        (example::<DisplayConfig>("display.toml"), example::<CullerConfig>("culler.toml"));
    let [cullers, listens] = [each(&display.cullers), each(&culler.listen)];
    assert_eq!((cullers.len(), listens.len()), (2, 1));
    let port = |endpoint: &Endpoint| endpoint.to_string().rsplit_once(':').unwrap().1.to_owned();
    for culler in cullers {
        assert_eq!((culler.transport(), port(culler)), (listens[0].transport(), port(listens[0])));
    }
}

#[test]
fn the_example_watcher_finds_the_relay_and_that_finds_the_culler() {
    let (relay, watcher) = (example::<RelayConfig>("relay.toml"), example::<WatcherConfig>("watcher.toml"));
    let culler: CullerConfig = example("culler.toml");
    let place = |endpoint: &Endpoint| {
        let port = endpoint.to_string().rsplit_once(':').unwrap().1.to_owned();
        (endpoint.transport().to_owned(), port)
    };
    let one = |endpoints: &Endpoints| place(endpoints.iter().next().unwrap());
    assert_eq!(one(&watcher.relay), one(&relay.listen));
    assert_eq!(one(&relay.upstream), place(each(&culler.listen)[0]));
    assert_eq!(watcher.scene, culler.scene);
}

#[test]
fn the_example_display_spells_out_the_defaults() {
    let display: DisplayConfig = example("display.toml");
    let defaults = SessionConfig::from_layer(Layer::default_values()).unwrap();
    assert_eq!(display.session, SessionConfig { frames: Some(200), ..defaults });
    assert_eq!(display.scene, Some(example::<CullerConfig>("culler.toml").scene));
}

#[test]
fn the_files_with_every_key_are_what_the_program_prints() {
    for (name, printed) in [
        ("display", DisplayConfig::template()),
        ("culler", CullerConfig::template()),
        ("relay", RelayConfig::template()),
        ("watcher", WatcherConfig::template()),
    ] {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("examples/configs/every-key/{name}.toml"));
        let kept = std::fs::read_to_string(&path).unwrap();
        assert!(
            kept == printed,
            "write it anew: trimaran config {name} > examples/configs/every-key/{name}.toml"
        );
    }
}

#[test]
fn the_encrypted_example_joins_machines_that_know_each_other() {
    let display: DisplayConfig = example("quic/display.toml");
    let cullers = [example::<CullerConfig>("quic/one.toml"), example("quic/two.toml")];
    let name = |path: &PathBuf| path.file_stem().unwrap().to_owned();
    let known: Vec<_> = display.peers.cullers.iter().map(name).collect();
    assert_eq!(cullers.each_ref().map(|culler| name(culler.common.keys.as_ref().unwrap())), known[..]);
    assert!(each(&display.cullers).iter().all(|culler| culler.needs_keys()));
    for (culler, other) in cullers.iter().zip(cullers.iter().rev()) {
        assert_eq!(each(&culler.listen)[0].transport(), each(&display.cullers)[0].transport());
        // The display must name a culler like the other culler does, or they cannot meet.
        let own = each(&culler.cullers)[0];
        assert!(each(&display.cullers).contains(&own) && !each(&other.cullers).contains(&own));
        let [displays, others] = [&culler.peers.displays, &culler.peers.cullers].map(|known| &known[..]);
        assert_eq!(
            displays.iter().map(name).collect::<Vec<_>>(),
            [name(display.common.keys.as_ref().unwrap())]
        );
        assert_eq!(others.iter().map(name).collect::<Vec<_>>(), [name(other.common.keys.as_ref().unwrap())]);
    }
}
