//! Drives protocols that are state machines: sockets, timers and frames.

use std::future::poll_fn;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use anyhow::Context as _;
use trimaran_net::{Instant, Net, RecvMeta, Transmit, UdpSocket, UdpSocketOptions};

use super::RunFuture;
use crate::meter::{Beat, Ends, Meter, frame_bytes, frame_number};

const PORTS: [u16; 2] = [7400, 7401];
/// No protocol sleeps longer.
const LONGEST: Duration = Duration::from_millis(100);

/// One end of a protocol. Times count from the beginning of the network.
pub(super) trait Machine {
    /// Sends a frame.
    fn send(&mut self, now: Duration, frame: Vec<u8>);

    /// A datagram has come.
    fn input(&mut self, now: Duration, datagram: &[u8]);

    /// Does what is due: datagrams to send, and frames that have come.
    fn advance(&mut self, now: Duration, out: &mut Vec<Vec<u8>>, frames: &mut Vec<Vec<u8>>);

    /// When to call `advance` next.
    fn wake(&self, now: Duration) -> Duration;

    /// Whether frames may be sent.
    fn is_connected(&self) -> bool {
        true
    }
}

/// The addresses of both ends: this one's peer is the other.
pub(super) type Addresses = [SocketAddr; 2];

/// Runs the machines that `make` gives for the sender and the receiver.
pub(super) fn run<M: Machine + 'static>(
    ends: Ends,
    make: impl FnOnce(Addresses) -> anyhow::Result<[M; 2]> + 'static,
) -> RunFuture {
    Box::pin(async move {
        let find = |net: Arc<dyn Net>, host: &'static str| async move {
            let found = net.resolve(&format!("{host}:0")).await?;
            anyhow::Ok(found.first().context("no address")?.ip())
        };
        let other = if ends.host == "sender" { "receiver" } else { ends.host };
        let sender = SocketAddr::new(find(Arc::clone(&ends.receiver), ends.host).await?, PORTS[0]);
        let receiver = SocketAddr::new(find(Arc::clone(&ends.sender), other).await?, PORTS[1]);
        let [near, far] = make([sender, receiver])?;
        let bind =
            |net: &Arc<dyn Net>, port| net.bind_udp(([0, 0, 0, 0], port).into(), UdpSocketOptions::default());
        let near = End {
            socket: bind(&ends.sender, PORTS[0])?,
            net: Arc::clone(&ends.sender),
            peer: receiver,
            machine: near,
            beat: None,
            frames: ends.frames,
            meter: Arc::clone(&ends.meter),
        };
        let far = End {
            socket: bind(&ends.receiver, PORTS[1])?,
            net: Arc::clone(&ends.receiver),
            peer: sender,
            machine: far,
            beat: None,
            frames: 0,
            meter: Arc::clone(&ends.meter),
        };
        let seconds = Duration::from_secs(1) * ends.frames / 60 + Duration::from_secs(5);
        let last = ends.sender.now().after(seconds);
        let done = async {
            while ends.meter.count() < ends.frames as usize && ends.sender.now() < last {
                trimaran_net::sleep_until(&*ends.sender, ends.sender.now().after(LONGEST)).await;
            }
        };
        tokio::select! {
            () = done => Ok(()),
            ended = near.drive() => ended,
            ended = far.drive() => ended,
        }
    })
}

struct End<M> {
    net: Arc<dyn Net>,
    socket: Arc<dyn UdpSocket>,
    peer: SocketAddr,
    machine: M,
    beat: Option<Beat>,
    /// Frames to send.
    frames: u32,
    meter: Arc<Meter>,
}

impl<M: Machine> End<M> {
    async fn drive(mut self) -> anyhow::Result<()> {
        let (mut out, mut frames) = (Vec::new(), Vec::new());
        loop {
            let now = self.net.now();
            if self.beat.is_none() && self.machine.is_connected() {
                self.beat = Some(Beat::starting(now, self.frames));
            }
            while let Some(beat) = self.beat.as_mut().filter(|beat| beat.due().is_some_and(|due| due <= now))
            {
                let number = beat.take();
                self.meter.begin(now);
                self.machine.send(since_start(now), frame_bytes(number));
            }
            self.machine.advance(since_start(now), &mut out, &mut frames);
            for datagram in out.drain(..) {
                self.transmit(&datagram).await?;
            }
            for frame in frames.drain(..) {
                let number = frame_number(&frame).context("a frame has other ids than were sent")?;
                self.meter.came(number, self.net.now(), true);
            }
            let wake = self.machine.wake(since_start(now)).min(since_start(now) + LONGEST);
            let wake = Instant::from_nanos(wake.as_nanos() as u64);
            let due = self.beat.as_ref().and_then(Beat::due);
            let wake = due.map_or(wake, |due| wake.min(due)).max(now.after(Duration::from_nanos(1)));
            self.receive(wake).await?;
        }
    }

    async fn transmit(&self, contents: &[u8]) -> io::Result<()> {
        let peer = self.peer;
        let transmit = Transmit { destination: peer, ecn: None, contents, segment_size: None, src_ip: None };
        loop {
            match self.socket.try_send(&transmit) {
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => {
                    let mut poller = Arc::clone(&self.socket).poller();
                    poll_fn(|cx| poller.as_mut().poll_writable(cx)).await?;
                }
                sent => return sent,
            }
        }
    }

    /// Receives what there is, or waits for it or for `wake`.
    async fn receive(&mut self, wake: Instant) -> io::Result<()> {
        let net = Arc::clone(&self.net);
        let mut timer = pin!(trimaran_net::sleep_until(&*net, wake));
        poll_fn(|cx| {
            let mut some = false;
            while let Poll::Ready(came) = self.poll_receive(cx) {
                came?;
                some = true;
            }
            if some { Poll::Ready(Ok(())) } else { timer.as_mut().poll(cx).map(Ok) }
        })
        .await
    }

    fn poll_receive(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let (mut room, mut meta) = (vec![0; 65_536], [RecvMeta::default()]);
        let count =
            std::task::ready!(self.socket.poll_recv(cx, &mut [IoSliceMut::new(&mut room)], &mut meta))?;
        let now = since_start(self.net.now());
        for meta in meta.iter().take(count).filter(|meta| meta.len > 0) {
            let received = room.get(..meta.len).unwrap_or_default();
            received.chunks(meta.stride.max(1)).for_each(|datagram| self.machine.input(now, datagram));
        }
        Poll::Ready(Ok(()))
    }
}

fn since_start(now: Instant) -> Duration {
    Duration::from_nanos(now.as_nanos())
}
