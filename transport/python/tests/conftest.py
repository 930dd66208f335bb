"""Shared by the tests: a protocol, and pairs of links over each transport."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import trimaran_transport as tt

VECTOR = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
ROBOT = tt.Protocol("robot/1", latest=VECTOR, header=VECTOR, item=VECTOR)

Pair = tuple[tt.Link, tt.Link]
MakePair = Callable[..., Pair]


@pytest.fixture
def known(tmp_path: Path) -> tuple[tt.Keys, tt.Keys]:
    """Two peers' keys, by way of their files."""
    files = [tt.Keys.generate(name).save(tmp_path) for name in ("panel", "robot")]
    panel, robot = (tt.Keys.read(private) for private, _ in files)
    assert tt.PublicKeys.read(files[1][1]).name == "robot"
    return panel, robot


@pytest.fixture(params=["tcp", "unix", "ws", "udp", "quic", "inproc"])
def endpoint(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An endpoint of each transport."""
    scheme: str = request.param
    local = {"unix": f"unix:{tmp_path}/socket", "inproc": f"inproc:{request.node.nodeid.__hash__()}"}
    return local.get(scheme, f"{scheme}://127.0.0.1:0")


@pytest.fixture
def pair(known: tuple[tt.Keys, tt.Keys]) -> Iterator[MakePair]:
    """Makes links: the connecting side, and the accepting one."""
    made: list[tt.Link] = []

    def make(at: str, protocol: tt.Protocol = ROBOT, **options: object) -> Pair:
        panel, robot = known
        keyed = at.startswith(("udp", "quic"))
        ours = {"keys": panel, "peers": [robot.public]} if keyed else {}
        theirs = {"keys": robot, "peers": [panel.public]} if keyed else {}
        with tt.listen(at, protocol, hello="robot", **theirs, **options) as listener:
            one = tt.connect(listener.endpoint, protocol, hello="panel", **ours, **options)
            other = listener.accept(10)
        made.extend((one, other))
        return one, other

    yield make
    for link in made:
        in_background(lambda link=link: quietly(link.close))
    # Both sides close at the same time.
    for thread in threading.enumerate():
        if thread.name == "background":
            thread.join(20)


def quietly(act: Callable[[], object]) -> None:
    try:
        act()
    except tt.TransportError:
        pass


def in_background(act: Callable[[], object]) -> threading.Thread:
    thread = threading.Thread(target=act, name="background", daemon=True)
    thread.start()
    return thread
