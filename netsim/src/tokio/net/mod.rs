//! TCP and UDP of the host on which the program runs.

mod address;
pub mod tcp;
mod udp;

pub use address::ToSocketAddrs;
pub use tcp::{TcpListener, TcpStream};
pub use udp::UdpSocket;
