//! The memory of a simulation is bounded by the packets in flight: an hour takes no more than a minute. Alone
//! in its program, whose allocator counts.
#![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

use std::alloc::System;
use std::sync::Arc;
use std::time::Duration;

use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use trimaran_net::{Net, TcpOptions};
use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_netsim::{Simulation, Topology};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Bytes that are held now.
fn held() -> isize {
    let stats = ALLOCATOR.stats();
    // Reallocations count here by their change in size.
    stats.bytes_allocated as isize - stats.bytes_deallocated as isize
}

#[test]
fn what_is_held_does_not_grow_with_what_was_sent() {
    let link = LinkModel::clean(Rate::new(100_000_000), Duration::from_millis(1));
    let topology = Topology::star(&["here", "there"], &link, &link);
    let simulation = Simulation::new(&topology, 1);
    let [here, there] = ["here", "there"].map(|name| Arc::new(simulation.net(topology.find(name).unwrap())));
    let (mut listener, _) = there.listen_tcp("0.0.0.0:7000".parse().unwrap(), TcpOptions::default()).unwrap();
    let (mut sender, mut receiver) = simulation
        .run(async {
            let to = here.resolve("there:7000").await.unwrap()[0];
            let (stream, accepted) =
                tokio::join!(here.connect_tcp(to, TcpOptions::default()), listener.accept());
            (stream.unwrap(), accepted.unwrap())
        })
        .unwrap();
    let mut megabytes = |count: usize| {
        simulation
            .run(async {
                let send = async {
                    for _ in 0..count {
                        sender.writer.write_all(&[7; 1_000_000]).await.unwrap();
                    }
                };
                let receive = async {
                    let mut buffer = vec![0; 65_536];
                    let mut left = count * 1_000_000;
                    while left > 0 {
                        left -= receiver.reader.read(&mut buffer).await.unwrap();
                    }
                };
                tokio::join!(send, receive);
            })
            .unwrap();
        held()
    };
    // Windows and queues grow to their size first.
    let (before, after) = (megabytes(5), megabytes(50));
    assert!(after - before < 20_000, "{before} bytes held after 5 MB, {after} after 55");
    assert!(simulation.now().as_nanos() > 4_000_000_000);
}
