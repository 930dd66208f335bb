//! UDP sockets of tokio, with the kernel features that `quinn-udp` offers: batches, segmentation, ECN,
//! destination addresses.

use std::fmt;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use quinn_udp::UdpSocketState;
use socket2::{Domain, Protocol, SockRef, Socket, Type};
use tokio::io::Interest;

use crate::{EcnCodepoint, RecvMeta, Transmit, UdpPoller, UdpSocket, UdpSocketOptions};

/// Binds a socket; the caller is within a runtime.
pub(super) fn bind(at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>> {
    let socket = Socket::new(Domain::for_address(at), Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_nonblocking(true)?;
    enlarge(&SockRef::from(&socket), options);
    socket.bind(&at.into())?;
    let state = UdpSocketState::new((&socket).into())?;
    Ok(Arc::new(TokioUdp { io: tokio::net::UdpSocket::from_std(socket.into())?, state }))
}

/// If the system refuses a larger buffer, the one it had works too.
fn enlarge(socket: &SockRef<'_>, options: UdpSocketOptions) {
    let send = options.send_buffer.map_or(Ok(()), |bytes| socket.set_send_buffer_size(bytes));
    let receive = options.recv_buffer.map_or(Ok(()), |bytes| socket.set_recv_buffer_size(bytes));
    if let Err(e) = send.and(receive) {
        tracing::debug!(error = &e as &dyn std::error::Error, "the system refuses larger UDP buffers");
    }
}

#[derive(Debug)]
struct TokioUdp {
    io: tokio::net::UdpSocket,
    state: UdpSocketState,
}

impl UdpSocket for TokioUdp {
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()> {
        let Transmit { destination, ecn, contents, segment_size, src_ip } = *transmit;
        let ecn = ecn.map(marked);
        let transmit = quinn_udp::Transmit { destination, ecn, contents, segment_size, src_ip };
        self.io.try_io(Interest::WRITABLE, || self.state.try_send((&self.io).into(), &transmit))
    }

    fn poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>> {
        Box::pin(Poller { socket: self, wait: None })
    }

    fn poll_recv(
        &self,
        cx: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [RecvMeta],
    ) -> Poll<io::Result<usize>> {
        let mut known = [quinn_udp::RecvMeta::default(); quinn_udp::BATCH_SIZE];
        let room = buffers.len().min(meta.len()).min(quinn_udp::BATCH_SIZE);
        loop {
            ready!(self.io.poll_recv_ready(cx))?;
            let mut filled = None;
            let read = self.io.try_io(Interest::READABLE, || {
                let count = self.state.recv((&self.io).into(), buffers, &mut known)?;
                filled = Some(count);
                // The system had no more: another call would only fail.
                if count < room { Err(io::ErrorKind::WouldBlock.into()) } else { Ok(()) }
            });
            match (filled, read) {
                (Some(filled), _) => {
                    meta.iter_mut().zip(&known).take(filled).for_each(|(meta, known)| *meta = told(known));
                    return Poll::Ready(Ok(filled));
                }
                // Some systems report here that an earlier datagram had no receiver: that concerns one peer,
                // not the socket.
                (None, Err(e))
                    if !matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::ConnectionReset) =>
                {
                    return Poll::Ready(Err(e));
                }
                (None, _) => {}
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.io.local_addr()
    }

    fn max_transmit_segments(&self) -> usize {
        self.state.max_gso_segments()
    }

    fn max_receive_segments(&self) -> usize {
        self.state.gro_segments()
    }

    fn may_fragment(&self) -> bool {
        self.state.may_fragment()
    }
}

fn told(known: &quinn_udp::RecvMeta) -> RecvMeta {
    let quinn_udp::RecvMeta { addr, len, stride, ecn, dst_ip, .. } = *known;
    let ecn = ecn.map(|mark| match mark {
        quinn_udp::EcnCodepoint::Ect0 => EcnCodepoint::Ect0,
        quinn_udp::EcnCodepoint::Ect1 => EcnCodepoint::Ect1,
        quinn_udp::EcnCodepoint::Ce => EcnCodepoint::Ce,
    });
    RecvMeta { addr, len, stride, ecn, dst_ip }
}

const fn marked(mark: EcnCodepoint) -> quinn_udp::EcnCodepoint {
    match mark {
        EcnCodepoint::Ect0 => quinn_udp::EcnCodepoint::Ect0,
        EcnCodepoint::Ect1 => quinn_udp::EcnCodepoint::Ect1,
        EcnCodepoint::Ce => quinn_udp::EcnCodepoint::Ce,
    }
}

/// A wait for room, kept between two polls; tokio's own poll allows one waiter for each socket.
struct Poller {
    socket: Arc<TokioUdp>,
    wait: Option<Pin<Box<dyn Future<Output = io::Result<()>> + Send + Sync>>>,
}

impl fmt::Debug for Poller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Poller").field("socket", &self.socket).finish_non_exhaustive()
    }
}

impl UdpPoller for Poller {
    fn poll_writable(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let Self { socket, wait } = &mut *self;
        let wait = wait.get_or_insert_with(|| {
            let socket = Arc::clone(socket);
            Box::pin(async move { socket.io.writable().await })
        });
        let writable = ready!(wait.as_mut().poll(cx));
        self.wait = None;
        Poll::Ready(writable)
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;

    use super::*;
    use crate::{Net, TokioNet};

    async fn send(socket: &Arc<dyn UdpSocket>, transmit: &Transmit<'_>) {
        let mut poller = Arc::clone(socket).poller();
        poll_fn(|cx| poller.as_mut().poll_writable(cx)).await.unwrap();
        socket.try_send(transmit).unwrap();
    }

    async fn receive(socket: &dyn UdpSocket, buffers: &mut [Vec<u8>]) -> Vec<RecvMeta> {
        let mut meta = vec![RecvMeta::default(); buffers.len()];
        let mut slices: Vec<_> = buffers.iter_mut().map(|b| IoSliceMut::new(b)).collect();
        let filled = poll_fn(|cx| socket.poll_recv(cx, &mut slices, &mut meta)).await.unwrap();
        meta.truncate(filled);
        meta
    }

    #[tokio::test]
    async fn datagrams_arrive_with_what_the_kernel_knows() {
        let net = TokioNet::current().unwrap();
        let options = UdpSocketOptions::default();
        let at = "127.0.0.1:0".parse().unwrap();
        let (a, b) = (net.bind_udp(at, options).unwrap(), net.bind_udp(at, options).unwrap());
        let transmit = Transmit {
            destination: b.local_addr().unwrap(),
            ecn: Some(EcnCodepoint::Ect0),
            contents: &[7; 1200],
            segment_size: None,
            src_ip: None,
        };
        send(&a, &transmit).await;
        let mut buffers = [vec![0; 2000], vec![0; 2000]];
        let [meta] = receive(&*b, &mut buffers).await[..] else { panic!("not one datagram") };
        assert_eq!((meta.len, meta.stride, meta.addr), (1200, 1200, a.local_addr().unwrap()));
        assert_eq!(meta.ecn, transmit.ecn);
        assert_eq!(buffers[0][..1200], [7; 1200]);
    }

    #[tokio::test]
    async fn several_datagrams_leave_in_one_transmit() {
        let net = TokioNet::current().unwrap();
        let options = UdpSocketOptions::default();
        let at = "[::1]:0".parse().unwrap();
        let (Ok(a), Ok(b)) = (net.bind_udp(at, options), net.bind_udp(at, options)) else { return };
        let segments = a.max_transmit_segments().min(3);
        let contents: Vec<u8> = (0..segments).flat_map(|n| vec![n as u8; 100]).collect();
        let destination = b.local_addr().unwrap();
        let segment_size = (segments > 1).then_some(100);
        send(&a, &Transmit { destination, ecn: None, contents: &contents, segment_size, src_ip: None }).await;
        let mut got = Vec::new();
        while got.len() < contents.len() {
            let mut buffers = [vec![0; 64 << 10]];
            for meta in receive(&*b, &mut buffers).await {
                assert_eq!(meta.stride, 100);
                got.extend_from_slice(&buffers[0][..meta.len]);
            }
        }
        assert_eq!(got, contents);
    }

    #[test]
    fn the_system_is_asked_for_buffers_of_another_size() {
        const BYTES: usize = 48 << 10;
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP)).unwrap();
        let before = (socket.send_buffer_size().unwrap(), socket.recv_buffer_size().unwrap());
        let ask = |bytes| {
            let options = UdpSocketOptions { send_buffer: bytes, recv_buffer: bytes };
            enlarge(&SockRef::from(&socket), options);
            (socket.send_buffer_size().unwrap(), socket.recv_buffer_size().unwrap())
        };
        assert_eq!(ask(None), before);
        let (send, receive) = ask(Some(BYTES));
        // Linux grants twice the size, for its own bookkeeping.
        assert!(
            (BYTES..=BYTES * 2).contains(&send) && (BYTES..=BYTES * 2).contains(&receive),
            "{send} {receive}"
        );
        assert_ne!((send, receive), before);
    }
}
