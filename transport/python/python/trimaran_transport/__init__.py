"""Links for frame-synchronous data over pluggable transports.

A link has four lanes in each direction: the latest value, frames of items, messages, and blobs.
See the package's README for an example.
"""

from ._errors import (
    ConnectError,
    KeysError,
    LinkClosed,
    LinkLost,
    ProtocolError,
    TransportError,
    TransportTimeout,
)
from ._links import (
    Bulk,
    Capabilities,
    Frame,
    Frames,
    Latest,
    Link,
    Listener,
    LinkStats,
    Messages,
    Peer,
    Published,
    Publisher,
    Skipped,
    SubscriberStats,
    connect,
    listen,
)
from ._native import Keys, PublicKeys
from ._protocol import Protocol

__all__ = [
    "Bulk",
    "Capabilities",
    "ConnectError",
    "Frame",
    "Frames",
    "Keys",
    "KeysError",
    "Latest",
    "Link",
    "LinkClosed",
    "LinkLost",
    "LinkStats",
    "Listener",
    "Messages",
    "Peer",
    "Protocol",
    "ProtocolError",
    "PublicKeys",
    "Published",
    "Publisher",
    "Skipped",
    "SubscriberStats",
    "TransportError",
    "TransportTimeout",
    "connect",
    "listen",
]
