"""Python against a peer in Rust, whose protocol has types."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator

import numpy as np
import pytest
from conftest import ROBOT, VECTOR

import trimaran_transport as tt

HELLO = b"\x05panel\x07"  # `Hello { name: "panel", map: 7 }` by postcard


@pytest.fixture
def robot() -> Iterator[subprocess.Popen[str]]:
    """A robot that `cargo build -p trimaran-python --example robot` made. `TRIMARAN_ROBOT` says where."""
    program = os.environ.get("TRIMARAN_ROBOT")
    if program is None:
        pytest.skip("TRIMARAN_ROBOT names no robot: `./x python` builds one")
    process = subprocess.Popen([program, "tcp://127.0.0.1:0"], stdout=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.wait()


def endpoint(robot: subprocess.Popen[str]) -> str:
    assert robot.stdout is not None
    return robot.stdout.readline().strip()


def test_a_panel_in_python_drives_a_robot_in_rust(robot: subprocess.Popen[str]) -> None:
    link = tt.connect(endpoint(robot), ROBOT, hello=HELLO)
    assert (link.peer.name, link.peer.hello) == ("robot", b"\x05robot\x07")
    link.latest.publish((1, 0, 0.5))
    assert link.latest.receive(10)["z"] == 0.5
    frame = link.frames.receive(10)
    assert (frame.number, frame.header["x"]) == (3, 1)
    assert frame.items.tolist() == [(4, 5, 6), (7, 8, 9)]
    items = np.zeros(10_000, VECTOR)
    items["z"] = np.arange(10_000)
    link.frames.send(items, (4, 5, 6))
    frame = link.frames.receive(10)
    assert frame.number == 10 and frame.header.item() == (4, 5, 6)
    assert np.array_equal(frame.items, items)
    blob = np.random.default_rng(1).bytes(1 << 18)
    link.bulk.send(blob)
    assert link.bulk.receive(10) == blob
    link.messages.send(b"\x01\x04bell")  # Play { sound: "bell" }
    assert link.messages.receive(10) == b"\x00"
    link.messages.send(b"\x00")  # Stop
    with pytest.raises(tt.LinkClosed, match="robot closed the link: the shift is over") as closed:
        link.messages.receive(10)
    assert closed.value.code == 5
    link.close()
    assert robot.wait(10) == 0


def test_the_robot_refuses_another_map(robot: subprocess.Popen[str]) -> None:
    at = endpoint(robot)
    with pytest.raises(tt.ConnectError, match="the maps differ"):
        tt.connect(at, ROBOT, hello=b"\x05panel\x08", timeout=0.3)
    with pytest.raises(tt.ConnectError, match="hello is malformed"):
        tt.connect(at, ROBOT, hello=b"\x05panel\x07\x07", timeout=0.3)
    other = tt.Protocol("robot/2", latest=VECTOR, header=VECTOR, item=VECTOR)
    with pytest.raises(tt.ConnectError, match="robot/2"):
        tt.connect(at, other, hello=HELLO, timeout=0.3)
    tt.connect(at, ROBOT, hello=HELLO).close(0, "enough")
