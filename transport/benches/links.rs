//! What a link costs, beside the bare TCP connection it stands on: a camera there and back, and a frame of 4,000 ids until the last
//! one has arrived. Each is measured between two threads, as the roles run.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a benchmark that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "the bare connection that links are measured against")]
#![allow(missing_docs, reason = "criterion's macros")]

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use trimaran_proto::{
    Camera, DrawableId, FrameEvent, FrameNumber, FrameStart, Goodbye, Identity, Role, SceneHash,
};
use trimaran_transport::{Link, LinkConfig, Listener, Net, Options, TokioNet, connect, inproc};

const IDS: u32 = 4000;

fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
}

fn identity(role: Role) -> Identity {
    Identity { role, scene: SceneHash(1), settings: None }
}

fn camera(frame: u32) -> Camera {
    Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(frame)).unwrap()
}

fn inproc_pair(runtime: &Runtime) -> (Link, Link) {
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let (ours, theirs) = (identity(Role::SwitchA), identity(Role::Display));
    inproc::pair(&net, ours, theirs, &LinkConfig::default()).unwrap()
}

fn tcp_pair(runtime: &Runtime) -> (Link, Link) {
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    runtime.block_on(async {
        let options = Options::default();
        let mut listener =
            Listener::bind(&net, &"tcp://127.0.0.1:0".parse().unwrap(), identity(Role::SwitchA), &options)
                .await
                .unwrap();
        let address = listener.local_endpoint().clone();
        let deadline = net.now().after(std::time::Duration::from_secs(10));
        let (there, here) = tokio::join!(
            connect(&net, &address, identity(Role::Display), &options, deadline),
            listener.accept(deadline),
        );
        (here.unwrap(), there.unwrap())
    })
}

fn bare_pair(runtime: &Runtime) -> (TcpStream, TcpStream) {
    runtime.block_on(async {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (there, here) = tokio::join!(TcpStream::connect(address), listener.accept());
        let (there, (here, _)) = (there.unwrap(), here.unwrap());
        there.set_nodelay(true).unwrap();
        here.set_nodelay(true).unwrap();
        (here, there)
    })
}

/// A camera there and back, over a link.
fn echo_cameras(c: &mut Criterion, name: &str, runtime: &Runtime, (mut ours, mut theirs): (Link, Link)) {
    let handle = runtime.handle().clone();
    let echo = std::thread::spawn(move || {
        handle.block_on(async {
            while let Ok(camera) = theirs.latest_rx.latest().await {
                theirs.latest_tx.publish(camera).unwrap();
            }
        });
    });
    let mut frame = 0;
    c.bench_function(name, |b| {
        b.iter(|| {
            frame += 1;
            runtime.block_on(async {
                ours.latest_tx.publish(camera(frame)).unwrap();
                black_box(ours.latest_rx.latest().await.unwrap());
            });
        });
    });
    runtime.block_on(ours.goodbye(Goodbye::Finished)).unwrap();
    echo.join().unwrap();
}

/// A frame of ids, acknowledged by a camera once its end has come.
fn send_frames(c: &mut Criterion, name: &str, runtime: &Runtime, (mut ours, mut theirs): (Link, Link)) {
    let handle = runtime.handle().clone();
    let sink = std::thread::spawn(move || {
        handle.block_on(async {
            while let Ok(event) = theirs.frames_rx.recv().await {
                match event {
                    FrameEvent::Ids(ids) => ids.iter().for_each(|id| {
                        black_box(id);
                    }),
                    FrameEvent::End(_) => theirs.latest_tx.publish(camera(0)).unwrap(),
                    FrameEvent::Begin(_) | FrameEvent::Stats(_) => {}
                }
            }
        });
    });
    let ids: Vec<DrawableId> = (0..IDS).map(DrawableId).collect();
    let mut frame = 0;
    c.bench_function(name, |b| {
        b.iter(|| {
            frame += 1;
            runtime.block_on(async {
                let start = FrameStart { frame: FrameNumber(frame), camera: camera(frame) };
                ours.frames_tx.begin(start).await.unwrap();
                ours.frames_tx.push(&ids).await.unwrap();
                ours.frames_tx.finish().await.unwrap();
                black_box(ours.latest_rx.latest().await.unwrap());
            });
        });
    });
    runtime.block_on(ours.goodbye(Goodbye::Finished)).unwrap();
    sink.join().unwrap();
}

/// `size` bytes there and 72 back over a bare connection.
fn bare(c: &mut Criterion, name: &str, runtime: &Runtime, size: usize) {
    let (mut ours, mut theirs) = bare_pair(runtime);
    let handle = runtime.handle().clone();
    let echo = std::thread::spawn(move || {
        handle.block_on(async {
            let mut bytes = vec![0; size];
            while theirs.read_exact(&mut bytes).await.is_ok() {
                theirs.write_all(&bytes[..Camera::SIZE]).await.unwrap();
            }
        });
    });
    let bytes = vec![7; size];
    let mut back = [0; Camera::SIZE];
    c.bench_function(name, |b| {
        b.iter(|| {
            runtime.block_on(async {
                ours.write_all(&bytes).await.unwrap();
                ours.read_exact(&mut back).await.unwrap();
            });
        });
    });
    drop(ours);
    echo.join().unwrap();
}

fn links(c: &mut Criterion) {
    let runtime = runtime();
    bare(c, "camera there and back/bare TCP", &runtime, Camera::SIZE);
    echo_cameras(c, "camera there and back/tcp", &runtime, tcp_pair(&runtime));
    echo_cameras(c, "camera there and back/inproc", &runtime, inproc_pair(&runtime));
    bare(c, "4,000 ids and an answer/bare TCP, one write", &runtime, 4 * IDS as usize);
    send_frames(c, "4,000 ids and an answer/tcp", &runtime, tcp_pair(&runtime));
    send_frames(c, "4,000 ids and an answer/inproc", &runtime, inproc_pair(&runtime));
}

criterion_group!(benches, links);
criterion_main!(benches);
