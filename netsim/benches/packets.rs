//! Packets per second of computing: datagrams and a TCP transfer over two links. The baseline is the least
//! work of any simulator for a packet: to put its events into a queue and take them out again.
#![allow(clippy::unwrap_used, reason = "a benchmark that cannot go on has failed")]
#![allow(missing_docs, reason = "criterion's macros")]

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::future::poll_fn;
use std::hint::black_box;
use std::io::IoSliceMut;
use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use trimaran_net::{Net, RecvMeta, TcpOptions, Transmit, UdpSocketOptions, sleep_until};
use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_netsim::{SimNet, Simulation, Topology};

/// Packets per run.
const PACKETS: u64 = 20_000;
/// The time of a packet at a gigabit a second, nanoseconds.
const GAP: u64 = 12_304;
/// The payload of a TCP segment.
const SEGMENT: u64 = 1448;

fn network() -> (Simulation, Arc<SimNet>, Arc<SimNet>) {
    let link = LinkModel::clean(Rate::new(1_000_000_000), Duration::from_micros(5));
    let topology = Topology::star(&["here", "there"], &link, &link);
    let simulation = Simulation::new(&topology, 1);
    let net = |name| Arc::new(simulation.net(topology.find(name).unwrap()));
    let (here, there) = (net("here"), net("there"));
    (simulation, here, there)
}

/// Two links. On each the line becomes free and a packet arrives: four events a packet, ten packets in
/// flight.
fn events() {
    let mut heap = BinaryHeap::new();
    for packet in 0..PACKETS {
        for event in 0..4_u64 {
            heap.push(Reverse((packet * GAP + event * 30_000, packet * 4 + event, [0_u64; 2])));
        }
        while heap.peek().is_some_and(|Reverse((at, ..))| *at <= packet * GAP) {
            black_box(heap.pop());
        }
    }
    while let Some(event) = heap.pop() {
        black_box(event);
    }
}

fn datagrams() -> u64 {
    let (simulation, here, there) = network();
    let options = UdpSocketOptions::default();
    let receiver = there.bind_udp("0.0.0.0:9000".parse().unwrap(), options).unwrap();
    let sender = here.bind_udp("0.0.0.0:0".parse().unwrap(), options).unwrap();
    let contents = [7; 1472];
    simulation
        .run(async {
            let destination = here.resolve("there:9000").await.unwrap()[0];
            let send = async {
                for packet in 0..PACKETS {
                    let transmit = Transmit {
                        destination,
                        ecn: None,
                        contents: &contents,
                        segment_size: None,
                        src_ip: None,
                    };
                    sender.try_send(&transmit).unwrap();
                    if packet % 16 == 15 {
                        sleep_until(&*here, here.now().after(Duration::from_nanos(16 * GAP))).await;
                    }
                }
            };
            let receive = async {
                let (mut got, mut buffer) = (0, vec![[0; 2000]; 16]);
                while got < PACKETS {
                    let mut meta = [RecvMeta::default(); 16];
                    let mut slices: Vec<_> = buffer.iter_mut().map(|bytes| IoSliceMut::new(bytes)).collect();
                    got += poll_fn(|cx| receiver.poll_recv(cx, &mut slices, &mut meta)).await.unwrap() as u64;
                }
            };
            tokio::join!(send, receive);
        })
        .unwrap();
    packets(&simulation)
}

fn transfer() -> u64 {
    let (simulation, here, there) = network();
    let options = TcpOptions::default();
    let (mut listener, _) = there.listen_tcp("0.0.0.0:7000".parse().unwrap(), options).unwrap();
    simulation
        .run(async {
            let to = here.resolve("there:7000").await.unwrap()[0];
            let (stream, accepted) = tokio::join!(here.connect_tcp(to, options), listener.accept());
            let (mut sender, mut receiver) = (stream.unwrap(), accepted.unwrap());
            let send = async {
                let part = vec![7; 64 << 10];
                for _ in 0..PACKETS * SEGMENT / part.len() as u64 {
                    sender.writer.write_all(&part).await.unwrap();
                }
                sender.writer.shutdown().await.unwrap();
            };
            let receive = async {
                let mut part = vec![0; 64 << 10];
                while receiver.reader.read(&mut part).await.unwrap() > 0 {}
            };
            tokio::join!(send, receive);
        })
        .unwrap();
    packets(&simulation)
}

/// Packets that hosts sent, counted at the first link of their paths.
fn packets(simulation: &Simulation) -> u64 {
    simulation.links().iter().step_by(2).map(|link| link.offered.packets).sum()
}

fn speed(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("packets");
    group.sample_size(10);
    group.throughput(Throughput::Elements(PACKETS)).bench_function("only their events", |b| b.iter(events));
    group.throughput(Throughput::Elements(datagrams())).bench_function("datagrams", |b| b.iter(datagrams));
    group.throughput(Throughput::Elements(transfer())).bench_function("tcp", |b| b.iter(transfer));
    group.finish();
}

criterion_group!(benches, speed);
criterion_main!(benches);
