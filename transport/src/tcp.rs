//! TCP: a connection for each lane of a pair of peers, as in the paper (section 5).

use std::sync::Arc;

use crate::transport::{AttemptError, ListenFault, Listening, Transport, first_address};
use trimaran_net::{BoxFuture, Net, Stream, StreamPeer, TcpOptions};

/// TCP connections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tcp(pub(crate) TcpOptions);

impl Transport for Tcp {
    fn scheme(&self) -> &'static str {
        "tcp"
    }

    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>> {
        Box::pin(open(net, self.0, address, beside))
    }

    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>> {
        Box::pin(async move {
            let at = first_address(net, address).await?;
            let (socket, address) = net.listen_tcp(at, self.0)?;
            Ok(Listening { socket, address: address.to_string() })
        })
    }
}

/// Opens a connection to `host:port`: tries each address of a host until one answers, or that of `beside`.
pub(crate) async fn open(
    net: &Arc<dyn Net>,
    options: TcpOptions,
    address: &str,
    beside: Option<StreamPeer>,
) -> Result<Stream, AttemptError> {
    let addresses = match beside {
        Some(StreamPeer::Tcp(at)) => vec![at],
        _ => net.resolve(address).await.map_err(AttemptError::Resolve)?,
    };
    let mut last = AttemptError::NoAddress;
    for to in addresses {
        match net.connect_tcp(to, options).await {
            Ok(stream) => return Ok(stream),
            Err(cause) => last = AttemptError::Connect { address: to.to_string(), cause },
        }
    }
    Err(last)
}
