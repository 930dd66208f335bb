//! A udp listener with several addresses, on a network of two machines: it answers from the address that was
//! contacted.
//!
//! Needs Linux and root; elsewhere the test says that it is skipped, and fails if `TRIMARAN_REQUIRE_NETNS` is
//! 1.

use std::{process::Command, sync::Arc, thread, time::Duration};

use tokio::{runtime::Builder, sync::oneshot};
use trimaran::netem::{Emulation, Namespace};
use trimaran_actors::{Link, Listener};
use trimaran_proto::{Identity, Role, SceneHash, Walkthrough};
use trimaran_transport::{Net, Options, TokioNet, connect, udp::Trust};

const SOON: Duration = Duration::from_secs(20);

fn ip(words: &[&str]) {
    let output = Command::new("ip").args(words).output().unwrap();
    assert!(output.status.success(), "{words:?}: {output:?}");
}

/// A machine with these addresses, and one with 10.3.0.9 and fd03::9, joined by a cable.
fn machines(addresses: &[&str]) -> [Namespace; 2] {
    let names = ["here", "there"].map(|name| format!("trimaran-addresses-{name}-{}", std::process::id()));
    let places = names.each_ref().map(|name| Namespace::find_or_make(name).unwrap());
    let [here, there] = &names;
    ip(&["-n", here, "link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", there]);
    let all =
        addresses.iter().map(|address| (here, *address)).chain([(there, "10.3.0.9"), (there, "fd03::9")]);
    for (place, address) in all {
        let (network, whole) = if address.contains(':') { ("/64", true) } else { ("/24", false) };
        // Without the wait for IPv6's duplicate address detection.
        let known: &[&str] = if whole { &["nodad"] } else { &[] };
        let words = ["-n", place, "address", "add", &format!("{address}{network}"), "dev", "eth0"];
        ip(&[&words[..], known].concat());
    }
    for name in &names {
        ip(&["-n", name, "link", "set", "eth0", "up"]);
    }
    places
}

/// The result of `act` on a machine, with sockets of that machine.
fn on<T: Send>(machine: &Namespace, act: impl AsyncFnOnce(Arc<dyn Net>) -> T + Send) -> T {
    thread::scope(|scope| {
        let acts = scope.spawn(move || {
            machine.enter().unwrap();
            let runtime = Builder::new_current_thread().enable_all().build().unwrap();
            let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
            runtime.block_on(act(net))
        });
        acts.join().unwrap()
    })
}

fn identity(role: Role) -> Identity {
    Identity { role, scene: Some(SceneHash(1).into()), session: None }
}

#[test]
fn a_listener_with_several_addresses_answers_from_the_one_that_was_asked() {
    if let Err(missing) = Emulation::possible() {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_NETNS").is_none_or(|value| value != "1"), "{missing}");
        return println!("skipped: {missing}");
    }
    let asked = ["10.3.0.1", "10.3.0.2", "10.3.0.3", "fd03::1", "fd03::2"];
    let [here, there] = machines(&asked);
    let mut options = Options::default();
    options.udp.trust = Trust::SharedKey([7; 32].into());
    for at in ["0.0.0.0", "[::]"] {
        for asked in asked.into_iter().filter(|asked| at == "[::]" || !asked.contains(':')) {
            let (tell, told) = oneshot::channel();
            let (options, done) = (&options, &tokio::sync::Notify::new());
            thread::scope(|scope| {
                let listens = scope.spawn(|| {
                    on(&here, async move |net| {
                        let at = format!("udp://{at}:4000").parse().unwrap();
                        let listener = Listener::bind(&net, &at, identity(Role::Culler), options).await;
                        let mut listener = listener.unwrap();
                        tell.send(()).unwrap();
                        let link: Link = listener.accept(net.now().after(SOON)).await.unwrap();
                        done.notified().await;
                        link.peer.address.to_string()
                    })
                });
                let connected = on(&there, async move |net| {
                    told.await.unwrap();
                    let asked = if asked.contains(':') { format!("[{asked}]") } else { asked.to_owned() };
                    let asked = format!("udp://{asked}:4000").parse().unwrap();
                    let by = net.now().after(SOON);
                    let link =
                        connect::<Walkthrough>(&net, &asked, identity(Role::Display), options, by).await;
                    done.notify_one();
                    link.map(|link| link.peer.hello.role)
                });
                assert_eq!(connected.unwrap(), Role::Culler, "{at}, asked at {asked}");
                let from = listens.join().unwrap();
                assert!(from.contains(if asked.contains(':') { "fd03::9" } else { "10.3.0.9" }), "{from}");
            });
        }
    }
}
