use std::time::Duration;

use confique::meta::{FieldKind, LeafKind, Meta};
use trimaran_proto::Role;
use trimaran_transport::Endpoints;

use super::*;
use crate::culling::CullingMethod;

const DISPLAY: &str = "scene = 'a'\ncullers = 'tcp://x:1'\nout = 'o'\n";

const RELAY: &str = "upstream = 'tcp://x:1'\nlisten = 'tcp://y:1,ws://y:2/w'\n";
const WATCHER: &str = "scene = '/s/a'\nrelay = 'tcp://x:1'\n";

fn written(text: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("role.toml");
    fs::write(&path, text).unwrap();
    (dir, path)
}

fn both<C: RoleConfig>(text: &str) -> Result<(C, Options), ConfigError> {
    let (_dir, path) = written(text);
    C::load(C::Layer::empty(), &[], Some(&path))
}

fn file<C: RoleConfig>(text: &str) -> Result<C, ConfigError> {
    both(text).map(|(config, _)| config)
}

fn defaults() -> SessionConfig {
    SessionConfig::from_layer(Layer::default_values()).unwrap()
}

#[test]
fn a_short_configuration_is_filled_with_defaults_and_paths_start_beside_it() {
    let (dir, path) =
        written("scene = 'a.scene'\nlisten = 'tcp://[::]:7400'\nout = '/tmp/x'\nkeys = 'k/one.key'\n");
    let (config, options) = DisplayConfig::load(Layer::empty(), &[], Some(&path)).unwrap();
    assert_eq!(options, Options::default());
    assert_eq!(config.session, defaults());
    assert_eq!((config.session.width, config.session.occlusion_test.as_str()), (1024, "hzb"));
    assert_eq!(config.scene, Some(dir.path().join("a.scene")));
    assert_eq!(config.common.keys, Some(dir.path().join("k/one.key")));
    assert_eq!(config.out, Path::new("/tmp/x"));
}

#[test]
fn the_authorities_of_links_are_beside_the_file_too() {
    let (dir, path) = written(&format!("{DISPLAY}[ws]\nca = 'plant.pem'\n"));
    let (_, options) = DisplayConfig::load(Layer::empty(), &[], Some(&path)).unwrap();
    assert_eq!(options.ws.ca, Some(dir.path().join("plant.pem")));
    let (_, options) = both::<DisplayConfig>(&format!("{DISPLAY}[ws]\nca = '/etc/plant.pem'\n")).unwrap();
    assert_eq!(options.ws.ca, Some("/etc/plant.pem".into()));
}

#[test]
fn a_flag_goes_before_the_file_and_its_paths_start_where_the_user_is() {
    let (_dir, path) =
        written(&format!("{DISPLAY}[session]\nbatch = 7\nseed = 8\n[udp]\nwindow = 7\ninitial_window = 8\n"));
    let mut flags = <DisplayConfig as Config>::Layer::empty();
    flags.session.batch = Some(9);
    flags.scene = Some("b.scene".into());
    let given = ["udp.window=9".parse().unwrap()];
    let (config, options) = DisplayConfig::load(flags, &given, Some(&path)).unwrap();
    assert_eq!((options.udp.window, options.udp.initial_window, options.udp.repair_percent), (9, 8, 15));
    assert_eq!((config.session.batch, config.session.seed, config.session.audit_every), (9, 8, 10));
    assert_eq!(config.scene, Some(Path::new("b.scene").to_owned()));
}

#[test]
fn a_cullers_configuration_survives_a_round_trip() {
    let peers = CullerPeers { displays: vec!["/k/display.pub".into()], cullers: Vec::new() };
    let config = CullerConfig {
        scene: "/s/a.scene".into(),
        listen: Some("tcp://0.0.0.0:7400,quic://0.0.0.0:7400".parse().unwrap()),
        displays: Some("quic://show:7400".parse().unwrap()),
        cullers: Some("tcp://one:7400".parse().unwrap()),
        culling: CullingMethod::GigaWalk,
        max_picture: "640x480".to_owned(),
        depth_memory: Some(bytesize::ByteSize::tib(1)),
        for_one_session: true,
        gpu: GpuConfig {
            device: None,
            gpu_memory: Some(bytesize::ByteSize::mib(64)),
            device_timeout_s: 30.0,
            check_device: false,
        },
        common: CommonConfig {
            join_timeout_s: 5.0,
            metrics: None,
            log: None,
            keys: Some("/k/two.key".into()),
        },
        peers,
    };
    let mut options = Options::default();
    options.udp.window = 12_345;
    options.tcp.keepalive = None;
    let text = [toml::to_string(&config).unwrap(), toml::to_string(&options).unwrap()].concat();
    assert_eq!(both::<CullerConfig>(&text).unwrap(), (config, options));
}

#[test]
fn a_key_that_nobody_gave_is_named() {
    let message = file::<DisplayConfig>("scene = 'a'\n").unwrap_err().to_string();
    assert!(message.contains("out"), "{message}");
    let message = file::<CullerConfig>("scene = 'a'\n").unwrap_err().to_string();
    assert!(message.contains("listen") && message.contains("`displays`"), "{message}");
}

#[test]
fn a_misspelt_key_is_named_with_its_line() {
    for (lines, key) in [
        ("[session]\nepsilon = 2\n", "epsilon"),
        ("[quic]\nwindows = 2\n", "windows"),
        ("keys = 'a'\nmetric = 'h:1'\n", "metric"),
        ("\n[common]\nmetrics = 'h:1'\n", "common"),
    ] {
        let message = file::<DisplayConfig>(&format!("{DISPLAY}{lines}")).unwrap_err().to_string();
        assert!(message.contains(&format!("`{key}`")) && message.contains("line 5"), "{message}");
    }
    let message = file::<RelayConfig>(&format!("{RELAY}device = 'a'\n")).unwrap_err().to_string();
    let expected = "line 3: unknown key `device`, expected `upstream`, `listen`, `join_timeout_s`, \
                    `metrics`, `log`, `keys`, `peers`, ";
    assert!(message.contains(expected) && message.contains("`tcp`"), "{message}");
}

#[test]
fn an_address_without_a_transport_is_refused_with_what_is_expected() {
    let message =
        file::<DisplayConfig>("scene = 'a'\ncullers = 'one:7400'\nout = 'o'\n").unwrap_err().to_string();
    assert!(message.contains("line 2") && message.contains("tcp://host:port"), "{message}");
}

#[test]
fn values_outside_their_range_are_refused_by_line_and_key() {
    for line in [
        "session.batch = 0",
        "session.batch = 16385",
        "session.epsilon_px = nan",
        "session.epsilon_px = 0",
        "session.width = 0",
        "session.frames = 0",
        "session.live_hz = 0",
        "session.coding = 'zip'",
        "session.occlusion_test = 'guess'",
        "schedule = 'guess'",
        "while_loading = 'guess'",
        "join_timeout_s = -1",
        "link.timeout_s = 1e9",
        "quic.congestion = 'reno'",
        "limits.handshakes = 3",
        "limits.handshakes_per_s = 3",
        "limits.handshakes_per_s_per_address = 3",
        "link.messages_per_s = -1",
        "tcp.nodelay = 1",
        "tcp.send_buffer = -1",
        "tcp.keepalive_s = -1",
        "tcp.user_timeout_s = 'never'",
        "unix.mode = '999'",
        "unix.mode = 600",
        "unix.allow_uids = [-1]",
        "udp.mode = 'fast'",
        "udp.deadline_ms = 0",
        "udp.repair = true",
        "udp.repair_percent = 0",
        "udp.trust = 'nobody'",
        "udp.initial_window = 1",
        "udp.max_datagram = 1501",
        "limits.peers = -1",
    ] {
        let key = line.split([' ', '.']).nth(line.split(' ').next().unwrap().matches('.').count()).unwrap();
        let message = file::<DisplayConfig>(&format!("{DISPLAY}{line}\n")).unwrap_err().to_string();
        assert!(message.contains(key) && message.contains("line 4"), "{line}: {message}");
    }
    let message = file::<DisplayConfig>(&format!("{DISPLAY}session.few_pixels = true\n")).unwrap_err();
    assert!(message.to_string().contains("session.few_pixels"), "{message}");
}

#[test]
fn a_display_has_as_many_cullers_as_its_schedule_can_take() {
    let cullers = |count: usize| vec!["'tcp://x:1'"; count].join(", ");
    let config = |count, schedule: &str| {
        let text =
            format!("scene = 'a'\nout = 'o'\ncullers = [{}]\nschedule = '{schedule}'\n", cullers(count));
        file::<DisplayConfig>(&text).map_err(|error| error.to_string())
    };
    assert!(file::<DisplayConfig>("scene = 'a'\nout = 'o'\n").is_ok(), "it culls for itself");
    assert!(config(1, "independent").is_ok() && config(8, "independent").is_ok());
    assert!(config(9, "independent").unwrap_err().contains("cullers"));
    assert!(config(2, "switch").is_ok());
    for count in [1, 3] {
        assert!(config(count, "switch").unwrap_err().contains("schedule"));
    }
}

#[test]
fn a_display_that_began_empty_is_told_what_to_show_while_it_loads() {
    let told = |line: &str| {
        let config = file::<DisplayConfig>(&format!("{DISPLAY}{line}\n")).unwrap();
        trimaran_actors::WhileLoading::from(config.while_loading)
    };
    assert_eq!(told(""), trimaran_actors::WhileLoading::Coarser);
    assert_eq!(told("while_loading = 'coarser'"), trimaran_actors::WhileLoading::Coarser);
    assert_eq!(told("while_loading = 'wait'"), trimaran_actors::WhileLoading::Wait);
}

/// Every leaf below `meta`, with its path.
fn leaves(meta: &Meta, under: &str, found: &mut Vec<(String, Option<&'static str>, LeafKind)>) {
    for field in shared::top(meta) {
        let path = if under.is_empty() { field.name.to_owned() } else { format!("{under}.{}", field.name) };
        assert!(!field.doc.is_empty(), "{path} is not described");
        match field.kind {
            FieldKind::Leaf { env, kind } => found.push((path, env, kind)),
            FieldKind::Nested { meta } => leaves(meta, &path, found),
        }
    }
}

/// The template with every key that has a default turned on, and every other one off.
fn template_in_step<C: RoleConfig>(required: &str) -> (C, Options) {
    let mut keys = Vec::new();
    leaves(&C::META, "", &mut keys);
    assert!(keys.len() >= 7, "{keys:?}");
    let template = C::template();
    for (path, env, kind) in &keys {
        let name = path.rsplit('.').next().unwrap();
        let env = env.unwrap_or_else(|| panic!("{path} has no environment variable"));
        assert_eq!(env, format!("TRIMARAN_{}", path.replace('.', "_").to_uppercase()));
        assert!(template.contains(env), "{env} is not in the template");
        let default = matches!(kind, LeafKind::Required { default: Some(_) });
        let shown = template.contains(&format!("\n#{name} ="));
        assert!(shown, "{path} (default: {default}) is not in the template:\n{template}");
    }
    for key in OptionKey::all() {
        let (_, name) = key.path.rsplit_once('.').unwrap();
        assert!(!key.meaning.is_empty(), "{} is not described", key.path);
        assert!(template.contains(&format!("`{}`", key.variable())), "{}", key.path);
        assert!(template.contains(&format!("\n#{name} =")), "{}", key.path);
    }
    let on = |line: &str| match line.strip_prefix('#') {
        Some(key) if key.starts_with(|c: char| c.is_ascii_lowercase()) && !key.trim_end().ends_with('=') => {
            key.to_owned()
        }
        _ => line.to_owned(),
    };
    let text: Vec<_> = template.lines().map(on).collect();
    both(&format!("{required}{}", text.join("\n"))).unwrap()
}

#[test]
fn the_templates_have_every_key_and_its_true_default() {
    let (display, options) = template_in_step::<DisplayConfig>(DISPLAY);
    assert_eq!((display.session, options), (defaults(), Options::default()));
    let required = "scene = 'a'\nlisten = 'tcp://x:1'\n";
    let (_, options) = template_in_step::<CullerConfig>(required);
    assert_eq!(options, Options::default());
    let (relay, _) = template_in_step::<RelayConfig>(RELAY);
    assert_eq!(relay, file(RELAY).unwrap());
    let (watcher, _) = template_in_step::<WatcherConfig>(WATCHER);
    assert_eq!(watcher, file(WATCHER).unwrap());
}

#[test]
fn a_relay_has_one_source_and_a_watcher_one_relay() {
    let relay = file::<RelayConfig>(RELAY).unwrap();
    assert_eq!((relay.upstream.iter().count(), relay.listen.iter().count()), (1, 2));
    let message = file::<RelayConfig>("upstream = ['tcp://x:1', 'tcp://x:2']\nlisten = 'tcp://y:1'\n");
    let message = message.unwrap_err().to_string();
    assert!(message.contains("upstream") && message.contains("give one endpoint"), "{message}");
    let message = file::<WatcherConfig>("scene = 'a'\nrelay = ['tcp://x:1', 'tcp://x:2']\n").unwrap_err();
    assert!(message.to_string().contains("relay"), "{message}");
    for (text, missing) in [("listen = 'tcp://y:1'\n", "upstream"), ("upstream = 'tcp://y:1'\n", "listen")] {
        let message = file::<RelayConfig>(text).unwrap_err().to_string();
        assert!(message.contains(missing), "{message}");
    }
    let message = file::<WatcherConfig>("scene = 'a'\n").unwrap_err().to_string();
    assert!(message.contains("relay"), "{message}");
}

#[test]
fn what_is_told_of_a_transport_reaches_its_links() {
    use trimaran_transport::{UdpMode, UdpSocketOptions, udp};
    let tcp =
        "[tcp]\nnodelay = false\nsend_buffer = 1\nrecv_buffer = 2\nkeepalive_s = 0\nuser_timeout_s = 3.5\n";
    let unix = "[unix]\nmode = '0660'\nallow_uids = [7, 8]\n";
    let udp = "[udp]\nmode = 'deadline'\ndeadline_ms = 12.5\nrepair = 'on'\nrepair_percent = 20\ntrust = 'plain'\n\
               initial_window = 10\nmax_datagram = 1200\nwindow = 3\nsend_buffer = 4\n\
               [udp.socket]\nsend_buffer = 5\nrecv_buffer = 5\n";
    let (_, options) = both::<DisplayConfig>(&format!("{DISPLAY}{tcp}{unix}{udp}")).unwrap();
    let tcp = options.tcp;
    assert_eq!(
        (tcp.nodelay, tcp.send_buffer, tcp.recv_buffer, tcp.keepalive),
        (false, Some(1), Some(2), None)
    );
    assert_eq!(tcp.user_timeout, Some(Duration::from_millis(3500)));
    assert_eq!((options.unix.mode, options.unix.allow_uids), (0o660, vec![7, 8]));
    let buffer = Some(5);
    let expected = udp::UdpOptions::default()
        .with_trust(udp::Trust::Plaintext)
        .with_mode(UdpMode::Deadline)
        .with_deadline(Duration::from_micros(12_500))
        .with_repair(udp::Repair::On)
        .with_repair_percent(20)
        .with_initial_window(10)
        .with_max_datagram(1200)
        .with_window(3)
        .with_send_buffer(4)
        .with_socket(UdpSocketOptions::default().with_send_buffer(buffer).with_recv_buffer(buffer));
    assert_eq!(options.udp, expected);
}

#[test]
fn datagrams_in_the_clear_need_no_keys() {
    let mut options = Options::default();
    let [udp, quic] = ["udp://a:1", "udp://a:1,quic://a:2"].map(|at| at.parse::<Endpoints>().unwrap());
    let none = [PeerFiles { name: "peers.cullers", role: None, paths: &[] }];
    assert!(security(&options, udp.iter(), None, &none).is_err());
    options.udp.trust = trimaran_transport::udp::Trust::Plaintext;
    assert_eq!(security(&options, udp.iter(), None, &none).unwrap(), None);
    let message = security(&options, quic.iter(), None, &none).unwrap_err().to_string();
    assert!(message.contains("quic://a:2"), "{message}");
}

#[test]
fn what_encrypts_needs_keys_of_both_sides() {
    let dir = tempfile::tempdir().unwrap();
    let make = |name: &str| {
        let keys = trimaran_transport::keys::Keys::generate(name.parse().unwrap()).unwrap();
        keys.save(dir.path()).unwrap()
    };
    let (one, two) = (make("one"), make("two"));
    let [tcp, both] = ["tcp://a:1", "tcp://a:1,quic://a:2"].map(|at| at.parse::<Endpoints>().unwrap());
    let none = |name| PeerFiles { name, role: Some(Role::Culler), paths: &[] };
    let public = [two.public];
    let peer = PeerFiles { paths: &public, ..none("peers.cullers") };
    let options = Options::default();
    assert_eq!(security(&options, tcp.iter(), None, &[none("peers.cullers")]).unwrap(), None);
    let peers = [none("peers.displays"), peer];
    let known = security(&options, both.iter(), Some(&one.private), &peers).unwrap().unwrap();
    assert_eq!(known.keys.public().name.as_str(), "one");
    let peers = known.peers.now();
    let known = peers.iter().map(|peer| (peer.keys.name.as_str(), peer.role.clone()));
    assert_eq!(known.collect::<Vec<_>>(), [("two", Some(String::from(Role::Culler)))]);
    for (keys, peer) in [(None, peer), (Some(one.private.as_path()), none("peers.cullers"))] {
        let message = security(&options, both.iter(), keys, &[peer]).unwrap_err().to_string();
        assert!(message.contains("quic://a:2") && message.contains("peers.cullers"), "{message}");
    }
    let swapped = security(&options, both.iter(), Some(&one.public), &[peer]).unwrap_err();
    assert!(matches!(swapped, ConfigError::Keys(KeysError::Public { .. })), "{swapped}");
}
