from collections.abc import Callable
from os import PathLike
from pathlib import Path

_Skipped = tuple[int, int, int]

class PublicKeys:
    """The public keys of a peer: its file ``NAME.pub``."""

    @staticmethod
    def read(path: str | PathLike[str]) -> PublicKeys:
        """Reads a public file."""
    @property
    def name(self) -> str:
        """The peer's name."""

class Keys:
    """The private keys of this peer: its file ``NAME.key``."""

    @staticmethod
    def generate(name: str) -> Keys:
        """New keys, which live as long as this object unless they are saved."""
    @staticmethod
    def read(path: str | PathLike[str]) -> Keys:
        """Reads a private file, which nobody else may be able to read."""
    def save(self, folder: str | PathLike[str]) -> tuple[Path, Path]:
        """Writes ``NAME.key`` and ``NAME.pub``, and returns their paths. Overwrites nothing."""
    @property
    def public(self) -> PublicKeys:
        """The matching public keys."""

class Setup:
    def __new__(
        cls,
        *,
        name: str,
        sizes: tuple[int, int, int],
        hello: bytes,
        options: str,
        keys: Keys | None,
        peers: list[PublicKeys],
        batch: int,
        max_frame: int,
        max_blob: int,
    ) -> Setup: ...

class Link:
    @property
    def peer(self) -> tuple[str, bytes, str, str]: ...
    @property
    def capabilities(self) -> tuple[bool, bool, bool, bool]: ...
    def stats(self) -> tuple[int, int, _Skipped]: ...
    def publish(self, value: bytes) -> None: ...
    def latest(self, timeout: float | None) -> bytes: ...
    def try_latest(self) -> bytes | None: ...
    def send_frame(self, number: int | None, header: bytes, items: bytes) -> int: ...
    def frame(self, timeout: float | None) -> tuple[int, bytes, bytearray, float, _Skipped]: ...
    def keep_last(self, depth: int, lifespan: float | None) -> None: ...
    def send_message(self, message: bytes) -> None: ...
    def message(self, timeout: float | None) -> bytes: ...
    def send_blob(self, blob: bytes, progress: Callable[[int, int], object] | None) -> None: ...
    def blob(
        self, timeout: float | None, progress: Callable[[int, int], object] | None
    ) -> bytes: ...
    def close(self, code: int, why: str) -> None: ...

def connect(endpoint: str, setup: Setup, timeout: float) -> Link: ...

class Listener:
    @property
    def endpoints(self) -> list[str]: ...
    def accept(self, timeout: float | None) -> Link: ...
    def close(self) -> None: ...

def listen(endpoints: list[str], setup: Setup) -> Listener: ...

class Publisher:
    def __new__(cls, setup: Setup) -> Publisher: ...
    def subscribe(self, link: Link, when_behind: str) -> int: ...
    def unsubscribe(self, link: Link) -> bool: ...
    def publish(
        self, number: int | None, header: bytes, items: bytes
    ) -> tuple[int, list[tuple[int, str]]]: ...
    def subscribers(self) -> dict[int, tuple[int, int, bool]]: ...
