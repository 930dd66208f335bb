//! TCP in virtual time: the conformance suite.

use trimaran_transport::conformance::Overhead;
use trimaran_transport::{Options, TcpOptions};

use crate::hosts::{Machines, gigabit};

conformance_in_virtual_time!(|| {
    let (send_buffer, recv_buffer) = (Some(64 * 1024), Some(64 * 1024));
    let tcp = TcpOptions::default().with_send_buffer(send_buffer).with_recv_buffer(recv_buffer);
    let options = Options::default().with_tcp(tcp);
    let overhead = Overhead { header_bytes: 4, handshake: 4, coded: true };
    Machines::joined([&gigabit(); 2], 1, "tcp", overhead, [options.clone(), options])
});
