//! The configurations in `examples/configs` are what the guide tells people to start from: they must be good.
#![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

use std::path::{Path, PathBuf};

use trimaran::config::{DisplayConfig, PairSeat, SessionConfig, SwitchConfig};

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/configs").join(name)
}

#[test]
fn the_pair_of_the_example_takes_both_seats_at_one_display() {
    let first = SwitchConfig::read(&example("first.toml")).unwrap();
    let second = SwitchConfig::read(&example("second.toml")).unwrap();
    assert_eq!((first.seat, second.seat), (PairSeat::First, PairSeat::Second));
    assert_eq!(first.display, second.display);
    assert_eq!(first.scene, second.scene);
}

#[test]
fn the_example_display_spells_out_the_defaults() {
    let display = DisplayConfig::read(&example("display.toml")).unwrap();
    assert_eq!(display.session, SessionConfig { frames: Some(200), ..SessionConfig::default() });
    assert_eq!(display.scene, SwitchConfig::read(&example("first.toml")).unwrap().scene);
}
