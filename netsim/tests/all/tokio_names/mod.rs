//! The names of tokio over a simulated host, compared with tokio itself.

use std::io::ErrorKind;
use std::time::Duration;

use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_netsim::tokio::net::{TcpListener, TcpStream, UdpSocket};
use trimaran_netsim::tokio::task::spawn_on;
use trimaran_netsim::tokio::time::{self, Instant};
use trimaran_netsim::tokio::{spawn, task};
use trimaran_netsim::{SimNet, Simulation, Topology};

use ::tokio::io::{AsyncReadExt, AsyncWriteExt};

mod real {
    #![allow(clippy::disallowed_methods, reason = "the real tokio, to compare with")]
    use ::tokio as tokio_real;
    use ::tokio::{net, task, time};

    include!("program.rs");
}

mod simulated {
    use ::tokio as tokio_real;
    use trimaran_netsim::tokio::{net, task, time};

    include!("program.rs");
}

fn hosts() -> (Simulation, [SimNet; 2]) {
    let line = LinkModel::clean(Rate::new(10_000_000), Duration::from_millis(20));
    let simulation = Simulation::new(&Topology::pair(["client", "server"], &line, &line), 1);
    let nets = ["client", "server"].map(|name| simulation.named(name).unwrap());
    (simulation, nets)
}

#[test]
fn a_program_does_here_what_it_does_on_tokio() {
    let runtime = ::tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let real = runtime.block_on(real::program()).unwrap();
    let (simulation, [client, _]) = hosts();
    let simulated = simulation.run(client.scope(simulated::program())).unwrap().unwrap();
    assert_eq!(simulated, real);
    assert_eq!(simulated[0], "6\n15\n");
    assert_eq!(simulation.now().as_nanos(), 26_000_000, "no more than it slept");
}

#[test]
fn names_lead_to_hosts_and_streams_take_the_time_of_their_links() {
    let (simulation, [client, server]) = hosts();
    spawn_on(&server, async {
        let listener = TcpListener::bind(("server", 80)).await.unwrap();
        let (mut stream, peer) = listener.accept().await.unwrap();
        assert_eq!(peer.ip().to_string(), "10.0.0.1");
        stream.write_all(&[7; 100_000]).await.unwrap();
    });
    let took = simulation.run(client.scope(async {
        let mut stream = TcpStream::connect("server:80").await.unwrap();
        assert_eq!(Instant::now() - Instant::now(), Duration::ZERO);
        let begun = Instant::now();
        let mut got = Vec::new();
        stream.read_to_end(&mut got).await.unwrap();
        assert_eq!(got.len(), 100_000);
        begun.elapsed()
    }));
    // 80 ms of bits, headers, and at most two round trips until the window is open.
    assert!((80..200).contains(&took.unwrap().as_millis()), "{took:?}");
}

#[test]
fn small_segments_wait_for_an_acknowledgement_until_nodelay_is_set() {
    let took = |nodelay: bool| {
        let (simulation, [client, server]) = hosts();
        spawn_on(&server, async {
            let listener = TcpListener::bind("0.0.0.0:80").await.unwrap();
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut bytes = [0; 2];
            stream.read_exact(&mut bytes).await.unwrap();
            stream.write_all(&bytes).await.unwrap();
        });
        let took = simulation.run(client.scope(async move {
            let mut stream = TcpStream::connect("server:80").await.unwrap();
            stream.set_nodelay(nodelay).unwrap();
            let begun = Instant::now();
            stream.write_all(&[1]).await.unwrap();
            time::sleep(Duration::from_millis(1)).await;
            stream.write_all(&[2]).await.unwrap();
            stream.read_exact(&mut [0; 2]).await.unwrap();
            begun.elapsed()
        }));
        took.unwrap()
    };
    assert!(took(true) < Duration::from_millis(45), "a round trip: {:?}", took(true));
    assert!(took(false) > Duration::from_millis(80), "two, and a delayed acknowledgement: {:?}", took(false));
}

#[test]
fn a_task_that_a_crash_ends_is_cancelled_and_a_peer_gives_up_as_linux_does() {
    let (simulation, [client, server]) = hosts();
    let control = simulation.control();
    let serve = spawn_on(&server, async {
        let listener = TcpListener::bind("0.0.0.0:80").await.unwrap();
        let (_stream, _) = listener.accept().await.unwrap();
        std::future::pending::<()>().await;
    });
    simulation
        .run(client.scope(async {
            let mut stream = TcpStream::connect("server:80").await.unwrap();
            task::yield_now().await;
            assert!(!serve.is_finished());
            control.crash(server.host());
            assert!(serve.await.unwrap_err().is_cancelled());
            assert!(spawn_on(&server, async {}).await.is_err(), "it is down");
            let begun = Instant::now();
            stream.write_all(b"anybody?").await.unwrap();
            let error = stream.read(&mut [0]).await.unwrap_err();
            assert_eq!((error.kind(), begun.elapsed().as_secs()), (ErrorKind::TimedOut, 924));
        }))
        .unwrap();
}

#[test]
fn a_program_on_no_host_has_time_and_no_sockets() {
    let (simulation, [client, _]) = hosts();
    simulation
        .run(async {
            client.scope(async {}).await; // and is there no longer
            assert!(spawn(async {}).await.is_err());
            let begun = Instant::now();
            time::sleep(Duration::from_secs(1)).await;
            assert_eq!(begun.elapsed(), Duration::from_secs(1));
            assert_eq!(Instant::now() - Duration::from_secs(1), Instant::now() - Duration::from_secs(9));
            let error = UdpSocket::bind("0.0.0.0:0").await.unwrap_err().to_string();
            assert!(error.contains("SimNet::scope"), "{error}");
        })
        .unwrap();
    assert_eq!(simulation.now().as_nanos(), 1_000_000_000);
}
