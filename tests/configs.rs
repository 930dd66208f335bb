//! The configurations in `examples/configs` are what docs/operations.md tells people to start from.
#![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

use std::path::{Path, PathBuf};

use confique::{Config, Layer};
use trimaran::config::{CullerConfig, DisplayConfig, RoleConfig, SessionConfig, Which};

fn example<C: RoleConfig>(name: &str) -> C {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/configs").join(name);
    C::load(Layer::empty(), &[], Some(&path)).unwrap().0
}

#[test]
fn the_cullers_of_the_example_take_both_places_at_one_display() {
    let first: CullerConfig = example("first.toml");
    let second: CullerConfig = example("second.toml");
    assert_eq!((first.index, second.index), (Which::First, Which::Second));
    assert_eq!(first.display, second.display);
    assert_eq!(first.scene, second.scene);
}

#[test]
fn the_example_display_spells_out_the_defaults() {
    let display: DisplayConfig = example("display.toml");
    let defaults = SessionConfig::from_layer(Layer::default_values()).unwrap();
    assert_eq!(display.session, SessionConfig { frames: Some(200), ..defaults });
    assert_eq!(display.scene, example::<CullerConfig>("first.toml").scene);
}

#[test]
fn the_files_with_every_key_are_what_the_program_prints() {
    for (name, printed) in [("display", DisplayConfig::template()), ("culler", CullerConfig::template())] {
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
fn the_encrypted_example_joins_three_machines_that_know_each_other() {
    let display: DisplayConfig = example("quic/display.toml");
    let pair = [example::<CullerConfig>("quic/first.toml"), example("quic/second.toml")];
    let name = |path: &Option<PathBuf>| path.as_ref().unwrap().file_stem().unwrap().to_owned();
    let known = [&display.peers.first, &display.peers.second].map(name);
    assert!(display.listen.first().needs_keys());
    assert_eq!(pair.each_ref().map(|machine| name(&machine.keys)), known);
    for (machine, other) in pair.iter().zip(pair.iter().rev()) {
        assert_eq!(machine.display.transport(), display.listen.first().transport());
        assert_eq!(name(&machine.peers.display), name(&display.keys));
        assert_eq!(name(&machine.peers.other), name(&other.keys));
    }
}
