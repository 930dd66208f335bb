//! Links over TCP: per pair of peers a connection for cameras and one for node ids, as in the paper (section 5).
//!
//! One peer listens, the other connects. The one that connects draws a session id and says hello on both connections; the
//! listener pairs them by the id, and answers both once both have come, or refuses with a reason.

mod connect;
mod desk;
mod handshake;
mod listen;
mod options;

pub use connect::{AttemptError, ConnectError, connect};
pub use handshake::HandshakeError;
pub use listen::{AcceptError, ListenError, Listener};
pub use options::{Keepalive, Options, TcpOptions};
