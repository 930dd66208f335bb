//! HTTP: who is served when many come, and asking others.

use std::{collections::VecDeque, error::Error, io, sync::Arc, time::Duration};

use http_body_util::{BodyExt, Empty, Limited};
use hyper::{Request, StatusCode, body::Bytes, client::conn::http1};
use hyper_util::rt::TokioIo;
use thiserror::Error as ThisError;
use tokio::{
    net::TcpStream,
    task::{AbortHandle, JoinSet},
};
use trimaran_net::{BoxFuture, Listen, Stream};
use trimaran_transport::{Net, sleep_until};

/// The pause after the system could not accept, for instance for want of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Serves whoever comes, for ever: `most` at once. One more takes the place of whoever came first: that one
/// has had time to ask, and who asks in earnest is not kept out by those who say nothing.
pub(crate) async fn serve(
    net: Arc<dyn Net>,
    mut listener: Box<dyn Listen>,
    most: usize,
    each: impl Fn(Stream) -> BoxFuture<'static, ()>,
) {
    let (mut guests, mut places, mut failing) = (JoinSet::new(), VecDeque::new(), false);
    loop {
        match listener.accept().await {
            Ok(stream) => {
                failing = false;
                while guests.try_join_next().is_some() {}
                places.retain(|guest: &AbortHandle| !guest.is_finished());
                if places.len() >= most
                    && let Some(first) = places.pop_front()
                {
                    first.abort();
                }
                places.push_back(guests.spawn(each(stream)));
            }
            Err(e) => {
                if !failing {
                    let error = &e as &dyn Error;
                    tracing::warn!(error, "could not accept whoever asks over HTTP; trying again");
                }
                failing = true;
                sleep_until(&*net, net.now().after(ACCEPT_PAUSE)).await;
            }
        }
    }
}

/// The most bytes of an answer.
const LONGEST: usize = 16 << 20;

/// Why an answer was not to be had.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum GetError {
    /// Nobody is there.
    #[error("nobody answers there")]
    Connect(#[source] io::Error),
    /// The target is none.
    #[error("that is no address")]
    Target(#[source] hyper::http::Error),
    /// The connection was lost, or carried something else.
    #[error("it does not speak HTTP to the end")]
    Exchange(#[source] hyper::Error),
    /// Its answer is longer than any, or was cut off.
    #[error("its answer does not come to an end")]
    Body(#[source] Box<dyn Error + Send + Sync>),
    /// It has no such thing, or not for whoever asks.
    #[error("it answers {0}")]
    Status(StatusCode),
}

/// What a server at a host and port, such as `127.0.0.1:7480`, has for a target, such as `/scene?token=T`.
///
/// # Errors
/// When it cannot be had.
pub async fn get(at: &str, target: &str) -> Result<Bytes, GetError> {
    let stream = TcpStream::connect(at).await.map_err(GetError::Connect)?;
    let (mut sender, connection) =
        http1::handshake(TokioIo::new(stream)).await.map_err(GetError::Exchange)?;
    let request =
        Request::get(target).header("host", at).body(Empty::<Bytes>::new()).map_err(GetError::Target)?;
    let exchange = async {
        let response = sender.send_request(request).await.map_err(GetError::Exchange)?;
        let status = response.status();
        let body = Limited::new(response.into_body(), LONGEST).collect().await.map_err(GetError::Body)?;
        let body = body.to_bytes();
        // With it the connection ends.
        drop(sender);
        Ok((status, body))
    };
    // The connection does the work that the exchange waits for; it may end first.
    let (_, exchanged) = tokio::join!(connection, exchange);
    match exchanged? {
        (StatusCode::OK, body) => Ok(body),
        (status, _) => Err(GetError::Status(status)),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::net::SocketAddr;

    use tokio::{
        io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex, split},
        sync::mpsc,
    };
    use trimaran_net::StreamPeer;
    use trimaran_transport::{TokioNet, until};

    use super::*;

    /// Guests that come one after the other.
    pub(crate) struct Guests(pub(crate) mpsc::UnboundedReceiver<DuplexStream>);

    impl Listen for Guests {
        fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
            Box::pin(async {
                self.0.recv().await.map(stream).ok_or_else(|| io::ErrorKind::BrokenPipe.into())
            })
        }
    }

    fn stream(guest: DuplexStream) -> Stream {
        let (reader, writer) = split(guest);
        let peer = StreamPeer::Tcp(SocketAddr::from(([127, 0, 0, 1], 1)));
        Stream { reader: Box::new(reader), writer: Box::new(writer), peer }
    }

    pub(crate) fn guest(come: &mpsc::UnboundedSender<DuplexStream>) -> DuplexStream {
        let (here, there) = duplex(64 << 10);
        come.send(there).unwrap();
        here
    }

    /// Sends back the first byte.
    fn echo(mut stream: Stream) -> BoxFuture<'static, ()> {
        Box::pin(async move {
            if let Ok(byte) = stream.reader.read_u8().await {
                let _gone = stream.writer.write_u8(byte).await;
            }
        })
    }

    /// Not even virtual time passes before the answer.
    #[tokio::test(start_paused = true)]
    async fn a_hundred_silent_guests_keep_nobody_waiting() {
        const MOST: usize = 64;
        let net = TokioNet::current().unwrap();
        let (come, guests) = mpsc::unbounded_channel();
        let mut server = JoinSet::new();
        server.spawn(serve(Arc::new(net.clone()), Box::new(Guests(guests)), MOST, echo));
        let (before, mut silent) = (net.now(), Vec::new());
        for _ in 0..100 {
            silent.push(guest(&come));
            tokio::task::yield_now().await;
        }
        let mut one = guest(&come);
        one.write_u8(7).await.unwrap();
        assert_eq!(one.read_u8().await.unwrap(), 7);
        assert_eq!(net.now(), before, "it was served at once");
        // No more are held than there are places: those who came first have lost theirs.
        let mut ended = 0;
        for guest in &mut silent {
            let end = until(&net, net.now(), guest.read_u8()).await;
            ended += usize::from(end.is_some());
        }
        assert_eq!(ended, 100 + 1 - MOST);
    }

    /// As without file descriptors.
    struct Failing {
        failures: usize,
        then: Option<DuplexStream>,
    }

    impl Listen for Failing {
        fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
            if let Some(left) = self.failures.checked_sub(1) {
                self.failures = left;
                return Box::pin(std::future::ready(Err(io::Error::from_raw_os_error(24))));
            }
            match self.then.take() {
                Some(guest) => Box::pin(std::future::ready(Ok(stream(guest)))),
                None => Box::pin(std::future::pending()),
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_system_that_cannot_accept_is_asked_again_after_a_pause_and_not_at_once() {
        const FAILURES: usize = 30;
        let net = TokioNet::current().unwrap();
        let began = net.now();
        let (mut here, there) = duplex(64 << 10);
        let listener = Box::new(Failing { failures: FAILURES, then: Some(there) });
        let answered = async {
            here.write_u8(9).await.unwrap();
            here.read_u8().await.unwrap()
        };
        tokio::select! {
            answer = answered => assert_eq!(answer, 9),
            () = serve(Arc::new(net.clone()), listener, 1, echo) => panic!("it serves for ever"),
        }
        assert_eq!(net.now().since(began), ACCEPT_PAUSE * FAILURES as u32);
    }
}
