"""Exceptions. The native half raises them."""

from __future__ import annotations

from collections.abc import Sequence


class TransportError(Exception):
    """Anything that goes wrong with a link. ``causes`` has its text and those of its causes."""

    causes: tuple[str, ...]

    def __init__(self, text: str, causes: Sequence[str] = ()) -> None:
        super().__init__(text)
        self.causes = tuple(causes) or (text,)


class ConnectError(TransportError):
    """No link was made, or nothing can listen there.

    ``may_pass``: the same call may succeed later. Otherwise this side's own settings have to change.
    """

    may_pass: bool = False


class KeysError(TransportError):
    """Keys cannot be made, read or written."""


class LinkClosed(TransportError):
    """Either side has closed the link. ``code`` and ``reason`` are the peer's."""

    code: int
    reason: str

    def __init__(self, text: str, causes: Sequence[str], code: int, reason: str) -> None:
        super().__init__(text, causes)
        self.code = code
        self.reason = reason


class LinkLost(TransportError):
    """The link ended without a close: the peer crashed, hangs, or cannot be reached."""


class ProtocolError(TransportError):
    """The peer broke the protocol, for instance by values of another size."""


class TransportTimeout(TransportError, TimeoutError):
    """The timeout of this call came. The link is as good as before."""
