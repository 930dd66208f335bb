//! What the bytes of a frame are told by, wherever that is: the printed table, the page, and the file of
//! figures.

use crate::simulate::FrameBytes;

/// One figure of a frame's bytes.
pub(in crate::report) struct Column {
    /// At the head of a table.
    pub(in crate::report) title: &'static str,
    /// At the head of `runs.csv`.
    pub(in crate::report) key: &'static str,
    /// The figure.
    pub(in crate::report) of: fn(&FrameBytes) -> f64,
}

/// All of them, in their order.
pub(in crate::report) const COLUMNS: [Column; 16] = [
    Column { title: "all", key: "bytes", of: |bytes| bytes.total },
    Column { title: "ids", key: "ids", of: |bytes| bytes.ids },
    Column { title: "messages", key: "messages", of: |bytes| bytes.messages },
    Column { title: "transport", key: "transport", of: |bytes| bytes.transport },
    Column { title: "tcp/udp", key: "transport_headers", of: |bytes| bytes.transport_headers },
    Column { title: "ip", key: "ip_headers", of: |bytes| bytes.ip_headers },
    Column { title: "link layer", key: "link_layer", of: |bytes| bytes.link_layer },
    Column { title: "packets", key: "packets", of: |bytes| bytes.packets },
    Column { title: "acks", key: "acknowledgements", of: |bytes| bytes.acknowledgements },
    Column { title: "repeated", key: "repetitions", of: |bytes| bytes.repetitions },
    Column { title: "keepalive", key: "keepalive", of: |bytes| bytes.keepalive },
    Column { title: "handshake, once", key: "handshake", of: |bytes| bytes.handshake },
    Column { title: "h", key: "header", of: |bytes| bytes.header },
    Column { title: "paper", key: "paper", of: |bytes| bytes.paper },
    Column { title: "added", key: "corrected", of: |bytes| bytes.corrected },
    Column { title: "added, h as is", key: "corrected_as_measured", of: |bytes| bytes.corrected_as_measured },
];
