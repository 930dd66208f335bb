"""Links, listeners and publishers."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any, Generic, Literal, NamedTuple, TypeVar

from numpy.typing import ArrayLike, NDArray

from . import _native
from ._errors import LinkClosed, ProtocolError
from ._native import Keys, PublicKeys
from ._protocol import Protocol, of_items, of_value, to_items, to_value

_T = TypeVar("_T")

Progress = Callable[[int, int], object]


class Skipped(NamedTuple):
    """Frames that came and were not returned, by cause."""

    replaced: int
    """A newer frame took their place."""
    expired: int
    """They had waited longer than their lifespan."""
    incomplete: int
    """They lacked items that were given up on a link with deadlines."""


class Peer(NamedTuple):
    """The other side of a link."""

    name: str
    """The text with which its hello begins, else ``the peer``."""
    hello: bytes
    """Its hello, as serde's postcard encodes it."""
    address: str
    """Its address when the link was made."""
    transport: str
    """``tcp``, ``udp``, ``quic``, ``ws``, ``unix`` or ``inproc``."""


class Capabilities(NamedTuple):
    """The guarantees of a transport."""

    reliable: bool
    """No frame is lost."""
    ordered: bool
    """Frames arrive in order."""
    encrypted: bool
    """Nobody on the path reads or changes data."""
    local: bool
    """Data stays on this machine."""


class LinkStats(NamedTuple):
    """Traffic of a link since it was made."""

    sent_bytes: int
    received_bytes: int
    skipped: Skipped


class Frame(NamedTuple):
    """A complete frame."""

    number: int
    """It rises from frame to frame."""
    header: Any
    """A value of ``Protocol.header``."""
    items: NDArray[Any]
    """An array of ``Protocol.item``. It is yours, and may be written."""
    age: float
    """Seconds from the arrival of its begin to its return. The way of the network is no part of it."""
    skipped: Skipped
    """The frames before it that were left out."""


class _Lane(Generic[_T]):
    """A lane that is received from. A loop over it ends when either side closes the link."""

    def receive(self, timeout: float | None = None) -> _T:
        raise NotImplementedError

    def __iter__(self) -> Iterator[_T]:
        while True:
            try:
                yield self.receive()
            except LinkClosed:
                return


class Latest(_Lane[Any]):
    """The latest lane: only the newest value counts."""

    def __init__(self, link: _native.Link, protocol: Protocol) -> None:
        self._link = link
        self._dtype = protocol.latest

    def publish(self, value: Any) -> None:
        """Publishes a value. Never waits: if the peer is slow, only the newest value waits for it."""
        self._link.publish(to_value(value, self._dtype, "value"))

    def receive(self, timeout: float | None = None) -> Any:
        """Waits for an unread value, and returns the newest."""
        return self._value(self._link.latest(timeout))

    def newest(self) -> Any | None:
        """The newest unread value, or ``None`` if there is none now. Never waits."""
        value = self._link.try_latest()
        return None if value is None else self._value(value)

    def _value(self, value: bytes) -> Any:
        return _checked(value, self._dtype, "value")


class Frames(_Lane[Frame]):
    """The frames lane: all items of a frame count."""

    def __init__(self, link: _native.Link, protocol: Protocol) -> None:
        self._link = link
        self._protocol = protocol

    def send(self, items: ArrayLike, header: Any = None, *, number: int | None = None) -> int:
        """Sends a frame, and returns its number: the last one's and 1, if none is given.

        Waits for room (backpressure), at most for the link's ``timeout_s``. An exception such as
        ``KeyboardInterrupt`` ends the wait, and the frame is sent all the same.
        """
        head = to_value(header, self._protocol.header, "header")
        return self._link.send_frame(number, head, to_items(items, self._protocol.item))

    def receive(self, timeout: float | None = None) -> Frame:
        """Waits for the next complete frame. Incomplete ones are skipped."""
        number, header, items, age, skipped = self._link.frame(timeout)
        head = _checked(header, self._protocol.header, "header")
        array = of_items(items, self._protocol.item)
        return Frame(number, head, array, age, Skipped(*skipped))

    def keep_last(self, depth: int = 1, lifespan: float | None = None) -> None:
        """From now on only the newest ``depth`` frames wait for this reader, of any speed.

        A frame that has waited for more than ``lifespan`` seconds is left out. ``Frame.skipped`` has the
        counts.
        """
        self._link.keep_last(depth, lifespan)


class Messages(_Lane[bytes]):
    """The messages lane: small messages that all arrive, in order. At most 16,384 bytes each."""

    def __init__(self, link: _native.Link) -> None:
        self._link = link

    def send(self, message: bytes) -> None:
        """Sends a message, whole or not at all. Waits for room, at most for the link's ``timeout_s``."""
        self._link.send_message(message)

    def receive(self, timeout: float | None = None) -> bytes:
        """Waits for the next message."""
        return self._link.message(timeout)


class Bulk(_Lane[bytes]):
    """The bulk lane: blobs of any length, which delay no other lane."""

    def __init__(self, link: _native.Link) -> None:
        self._link = link

    def send(self, blob: bytes, progress: Progress | None = None) -> None:
        """Sends a blob. An exception, also one that ``progress`` raises, cancels it.

        ``progress`` is called with the bytes so far and the length, up to 20 times a second.
        """
        self._link.send_blob(bytes(blob), progress)

    def receive(self, timeout: float | None = None, progress: Progress | None = None) -> bytes:
        """Waits for a whole blob. A timeout loses nothing: call again to go on.

        :raises TransportError: the peer gave it up, or it is longer than ``max_blob``.
        """
        return self._link.blob(timeout, progress)


class Link:
    """A link to a peer. Any thread may use any lane, and each lane at the same time.

    Close it with a reason, or by ``with``. One that is dropped looks like a crash to the peer.
    """

    def __init__(self, link: _native.Link, protocol: Protocol) -> None:
        self._link = link
        self.protocol = protocol
        self.latest = Latest(link, protocol)
        self.frames = Frames(link, protocol)
        self.messages = Messages(link)
        self.bulk = Bulk(link)
        self.peer = Peer(*link.peer)
        self.capabilities = Capabilities(*link.capabilities)

    def stats(self) -> LinkStats:
        """The traffic so far."""
        sent, received, skipped = self._link.stats()
        return LinkStats(sent, received, Skipped(*skipped))

    def close(self, code: int = 0, reason: str = "") -> None:
        """Closes the link, and ends every wait for it. The peer is told the code and the reason.

        Waits at most half a second for the peer to close as well. Closing again does nothing.

        :raises LinkLost: the peer is gone without a close of its own.
        """
        self._link.close(code, reason)

    def __enter__(self) -> Link:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.close(0, "done")
            return
        try:
            self.close(1, kind.__name__ if kind else "")
        except Exception:  # The error that ends the block says more.
            pass

    def __repr__(self) -> str:
        return f"<Link to {self.peer.name} at {self.peer.transport} {self.peer.address}>"


class Listener:
    """Accepts peers. Make one by :func:`listen`."""

    def __init__(self, listener: _native.Listener, protocol: Protocol) -> None:
        self._listener = listener
        self.protocol = protocol

    @property
    def endpoints(self) -> list[str]:
        """The endpoints, with the ports that the system chose."""
        return self._listener.endpoints

    @property
    def endpoint(self) -> str:
        """The first endpoint."""
        return self.endpoints[0]

    def accept(self, timeout: float | None = None) -> Link:
        """Waits for the next peer. Those of another protocol are refused, and the wait goes on."""
        return Link(self._listener.accept(timeout), self.protocol)

    def close(self) -> None:
        """Stops listening, and ends every wait. Links live on."""
        self._listener.close()

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Published(NamedTuple):
    """The result of publishing a frame."""

    number: int
    left: list[tuple[Link, str]]
    """The subscribers that have left since the last frame, and why."""


class SubscriberStats(NamedTuple):
    """The frames of a subscriber."""

    sent: int
    skipped: int
    is_behind: bool


class Publisher:
    """Sends each frame to many subscribers, over links of any transports. Its bytes are shared."""

    def __init__(
        self, protocol: Protocol, *, batch: int = 256, max_frame: int = 4_194_304
    ) -> None:
        self.protocol = protocol
        setup = _setup(protocol, b"", {}, None, (), batch, max_frame, 0)
        self._publisher = _native.Publisher(setup)
        self._links: dict[int, Link] = {}

    def subscribe(
        self, link: Link, when_behind: Literal["skip", "wait", "disconnect"] = "skip"
    ) -> None:
        """Adds a subscriber, which gets the last frame at once. From now on this sends its frames.

        :param when_behind: what one that is too slow gets: the newest frame (``skip``), every frame while
            ``publish`` waits (``wait``), or no more (``disconnect``).
        """
        if link.protocol != self.protocol:
            raise ValueError(f"the link has {link.protocol}, and this publishes {self.protocol}")
        self._links[self._publisher.subscribe(link._link, when_behind)] = link

    def unsubscribe(self, link: Link) -> bool:
        """Removes a subscriber once it has all of its frames. Whether its link still works."""
        number = next((number for number, known in self._links.items() if known is link), None)
        if number is None:
            return False
        del self._links[number]
        return self._publisher.unsubscribe(link._link)

    def publish(
        self, items: ArrayLike, header: Any = None, *, number: int | None = None
    ) -> Published:
        """Sends a frame to all subscribers. Waits only for those of ``wait`` that are behind."""
        head = to_value(header, self.protocol.header, "header")
        sent, left = self._publisher.publish(number, head, to_items(items, self.protocol.item))
        gone = [(self._links.pop(number), why) for number, why in left if number in self._links]
        return Published(sent, gone)

    def subscribers(self) -> list[tuple[Link, SubscriberStats]]:
        """The subscribers, with the counts of their frames."""
        stats = self._publisher.subscribers()
        return [(link, SubscriberStats(*stats[n])) for n, link in self._links.items() if n in stats]


def connect(
    endpoint: str,
    protocol: Protocol,
    *,
    hello: bytes | str = b"",
    timeout: float = 10.0,
    keys: Keys | None = None,
    peers: Sequence[PublicKeys] = (),
    options: Mapping[str, Any] | None = None,
    batch: int = 256,
    max_frame: int = 4_194_304,
    max_blob: int = 1 << 30,
) -> Link:
    """Connects to a listener, and tries again until the timeout: either side may start first.

    :param endpoint: ``tcp://host:port``, ``udp://host:port``, ``quic://host:port``,
        ``ws://host:port/path``, ``unix:/path`` or ``inproc:name``.
    :param hello: how this side introduces itself, at most 200 bytes. A ``str`` is a Rust ``String``.
    :param keys: this side's keys, for ``quic`` and ``udp``.
    :param peers: the public keys of the peers that it knows; all others are refused.
    :param options: as the crate's ``Options`` in a configuration file:
        ``{"link": {"idle_timeout_s": 1}}``.
    :param batch: how many items travel in a batch, 1 to 16,384.
    :param max_frame: how many items a frame may have.
    :param max_blob: how many bytes a received blob may have.
    :raises ConnectError: no link was made.
    """
    setup = _setup(protocol, hello, options, keys, peers, batch, max_frame, max_blob)
    return Link(_native.connect(endpoint, setup, timeout), protocol)


def listen(
    endpoints: str | Sequence[str],
    protocol: Protocol,
    *,
    hello: bytes | str = b"",
    keys: Keys | None = None,
    peers: Sequence[PublicKeys] = (),
    options: Mapping[str, Any] | None = None,
    batch: int = 256,
    max_frame: int = 4_194_304,
    max_blob: int = 1 << 30,
) -> Listener:
    """Listens at an endpoint or several. Port 0 takes a free port. The rest is as for :func:`connect`.

    :raises ConnectError: nothing can listen there.
    """
    setup = _setup(protocol, hello, options, keys, peers, batch, max_frame, max_blob)
    at = [endpoints] if isinstance(endpoints, str) else list(endpoints)
    return Listener(_native.listen(at, setup), protocol)


def _setup(
    protocol: Protocol,
    hello: bytes | str,
    options: Mapping[str, Any] | None,
    keys: Keys | None,
    peers: Sequence[PublicKeys],
    batch: int,
    max_frame: int,
    max_blob: int,
) -> _native.Setup:
    return _native.Setup(
        name=protocol.name,
        sizes=protocol.sizes,
        hello=_text(hello) if isinstance(hello, str) else bytes(hello),
        options=json.dumps({} if options is None else dict(options)),
        keys=keys,
        peers=list(peers),
        batch=batch,
        max_frame=max_frame,
        max_blob=max_blob,
    )


def _text(text: str) -> bytes:
    """A text as postcard has it: its length as a varint of 7 bits a byte, then UTF-8."""
    data = text.encode()
    length, head = len(data), bytearray()
    while length >= 128:
        head.append(length % 128 + 128)
        length //= 128
    return bytes([*head, length]) + data


def _checked(data: bytes, dtype: Any, kind: str) -> Any:
    """A value of a peer in this process, which may have another size."""
    size = 0 if dtype is None else dtype.itemsize
    if len(data) != size:
        raise ProtocolError(f"a {kind} of {len(data)} bytes came, and {dtype} has {size}")
    return of_value(data, dtype)
