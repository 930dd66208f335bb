//! Links over WebSockets (RFC 6455), which pass proxies and open from pages in browsers: one for each lane,
//! as over TCP. `wss://` connects over TLS.

mod bytes;
mod options;
mod origin;
mod tls;

use std::io;
use std::sync::Arc;

use tokio::io::{AsyncRead, AsyncWrite, join};
use tokio_tungstenite::tungstenite::handshake::server::{
    ErrorResponse, Request, Response, create_response_with_body,
};
use tokio_tungstenite::tungstenite::http::{self, StatusCode};
use tokio_tungstenite::tungstenite::protocol::Role;
use tokio_tungstenite::{WebSocketStream, accept_hdr_async_with_config, client_async_with_config};
use trimaran_net::{BoxFuture, Net, Stream, StreamPeer, TcpOptions};

pub use options::WsOptions;
pub use origin::{ForeignOrigin, Origin, OriginError, Site};

use crate::WsEndpoint;
use crate::tcp;
use crate::transport::{AttemptError, ListenFault, Listening, Transport, Upgrade, first_address};

/// WebSockets over TCP, or over TLS.
#[derive(Debug, Clone)]
pub(crate) struct WebSockets {
    pub(crate) at: WsEndpoint,
    pub(crate) is_encrypted: bool,
    pub(crate) tcp: TcpOptions,
    pub(crate) options: WsOptions,
}

impl Transport for WebSockets {
    fn scheme(&self) -> &'static str {
        if self.is_encrypted { "wss" } else { "ws" }
    }

    fn is_encrypted(&self) -> bool {
        self.is_encrypted
    }

    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>> {
        Box::pin(async move {
            let failed = |cause| AttemptError::Connect { address: address.to_owned(), cause };
            let mut stream = tcp::open(net, self.tcp, &self.at.at.to_string(), beside).await?;
            if self.is_encrypted {
                stream = self.options.encrypt(&self.at.at.host, stream).await.map_err(failed)?;
            }
            let Stream { reader, writer, peer } = stream;
            let url = format!("{}://{}{}", self.scheme(), self.at.at, self.at.path.as_str());
            let (socket, _answer) =
                client_async_with_config(url, join(reader, writer), Some(bytes::config()))
                    .await
                    .map_err(|e| failed(bytes::io_error(e)))?;
            Ok(bytes::of(socket, peer))
        })
    }

    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        _address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>> {
        Box::pin(async move {
            if self.is_encrypted {
                let why = "links do not listen over TLS: listen at ws:// behind a proxy that does";
                return Err(io::Error::new(io::ErrorKind::Unsupported, why).into());
            }
            let at = first_address(net, &self.at.at.to_string()).await?;
            let (socket, at) = net.listen_tcp(at, self.tcp)?;
            let at = WsEndpoint { at: at.into(), path: self.at.path.clone() };
            Ok(Listening { socket, address: at.to_string() })
        })
    }

    fn upgrade(&self) -> Option<&dyn Upgrade> {
        Some(self)
    }
}

impl Upgrade for WebSockets {
    fn upgrade(&self, stream: Stream) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async move {
            let Stream { reader, writer, peer } = stream;
            let mut refused = None;
            #[expect(clippy::result_large_err, reason = "as tungstenite has it")]
            let check = |request: &Request, response: Response| -> Result<Response, ErrorResponse> {
                if request.uri() != self.at.path.as_str() {
                    return Err(refuse(StatusCode::NOT_FOUND));
                }
                self.options.check(request.headers()).map_err(|e| {
                    refused = Some(e);
                    refuse(StatusCode::FORBIDDEN)
                })?;
                Ok(response)
            };
            let accepted =
                accept_hdr_async_with_config(join(reader, writer), check, Some(bytes::config())).await;
            match (accepted, refused) {
                (Ok(socket), _) => Ok(bytes::of(socket, peer)),
                (Err(_), Some(foreign)) => Err(io::Error::new(io::ErrorKind::PermissionDenied, foreign)),
                (Err(e), None) => Err(bytes::io_error(e)),
            }
        })
    }
}

/// The answer that upgrades an HTTP connection to a WebSocket (RFC 6455, section 4.2.2), for a server that
/// offers more than links at its port. `None` if `request` asks for none.
///
/// [`WsOptions::check`] decides whether its page may have one.
#[must_use]
pub fn answer<B>(request: &http::Request<B>) -> Option<http::Response<()>> {
    create_response_with_body(request, || ()).ok()
}

/// The bytes of a WebSocket whose [`answer`] was sent over `connection`, for a listener with its own
/// [`Transport`].
pub async fn stream<S>(connection: S, peer: StreamPeer) -> Stream
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let socket = WebSocketStream::from_raw_socket(connection, Role::Server, Some(bytes::config())).await;
    bytes::of(socket, peer)
}

/// A refusing answer.
fn refuse(status: StatusCode) -> ErrorResponse {
    let mut response = ErrorResponse::new(None);
    *response.status_mut() = status;
    response
}
