"""An application's protocol: a name, and the dtypes of its values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray


class Protocol:
    """The protocol of both sides of a link. They need the same name, and dtypes of the same sizes.

    :param name: with a version, such as ``"robot/1"``; at most 32 bytes.
    :param latest: the dtype of a value of the latest lane, at most 1,024 bytes. ``None``: no value.
    :param header: the dtype of a frame's header, at most 1,024 bytes. ``None``: no header.
    :param item: the dtype of a frame's items, 1 to 256 bytes. The default is Rust's ``u32``.

    Give the byte order where programs on other machines are peers: ``"<f4"``. A structured dtype is as
    Rust's ``#[repr(C)]`` with ``align=True``, and without padding else.
    """

    __slots__ = ("name", "latest", "header", "item")

    name: str
    latest: np.dtype[Any] | None
    header: np.dtype[Any] | None
    item: np.dtype[Any]

    def __init__(
        self,
        name: str,
        *,
        latest: DTypeLike | None = None,
        header: DTypeLike | None = None,
        item: DTypeLike = "<u4",
    ) -> None:
        self.name = name
        self.latest = None if latest is None else _plain(latest)
        self.header = None if header is None else _plain(header)
        self.item = _plain(item)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Protocol):
            return NotImplemented
        return self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        return f"Protocol({self.name!r}, latest={self.latest}, header={self.header}, item={self.item})"

    def _key(self) -> tuple[object, ...]:
        return (self.name, self.latest, self.header, self.item)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Bytes of a value, a header and an item."""
        return (_size(self.latest), _size(self.header), self.item.itemsize)


def _plain(dtype: DTypeLike) -> np.dtype[Any]:
    plain = np.dtype(dtype)
    if plain.hasobject:
        raise TypeError(f"{plain} holds Python objects, and these do not travel")
    return plain


def _size(dtype: np.dtype[Any] | None) -> int:
    return 0 if dtype is None else dtype.itemsize


def _array(data: ArrayLike, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The data as an array. Numbers are not cut: no ``int`` is made of a ``float``."""
    if isinstance(data, (np.ndarray, np.generic)):
        return np.asarray(data).astype(dtype, casting="same_kind", copy=False)
    return np.asarray(data, dtype)


def to_value(data: Any, dtype: np.dtype[Any] | None, kind: str) -> bytes:
    """The bytes of one value."""
    if dtype is None:
        if data is not None:
            raise TypeError(f"this protocol has no {kind}, and {data!r} is given")
        return b""
    if data is None:
        raise TypeError(f"this protocol has a {kind} of {dtype}, and None is given")
    base, shape = dtype.subdtype or (dtype, ())
    array = _array(data, base)
    if array.shape != shape:
        raise ValueError(f"a {kind} has the shape {shape}, and {array.shape} is given")
    return array.tobytes()


def of_value(data: bytes, dtype: np.dtype[Any] | None) -> Any:
    """The value in the bytes: a scalar or a ``numpy.void``, or an array if the dtype is one."""
    if dtype is None:
        return None
    return _items(data, dtype)[0]


def to_items(data: ArrayLike, dtype: np.dtype[Any]) -> bytes:
    """The bytes of items."""
    base, shape = dtype.subdtype or (dtype, ())
    array = _array(data, base)
    if array.size == 0:
        return b""
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape:
        raise ValueError(f"items have the shape {('n', *shape)}, and {array.shape} is given")
    return array.tobytes()


def of_items(data: bytearray, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The items in the bytes, which are not copied."""
    return _items(data, dtype)


def _items(data: bytes | bytearray, dtype: np.dtype[Any]) -> NDArray[Any]:
    base, shape = dtype.subdtype or (dtype, ())
    if len(data) % dtype.itemsize:
        from ._errors import ProtocolError

        raise ProtocolError(f"{len(data)} bytes came, and {dtype} has {dtype.itemsize}")
    return np.frombuffer(data, base).reshape(-1, *shape)
