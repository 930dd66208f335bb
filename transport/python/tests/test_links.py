"""Both ends in Python, over each transport."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from conftest import ROBOT, VECTOR, MakePair, in_background

import trimaran_transport as tt


def test_all_lanes_carry_data_both_ways(endpoint: str, pair: MakePair) -> None:
    panel, robot = pair(endpoint)
    assert (robot.peer.name, robot.peer.hello) == ("panel", b"\x05panel")
    assert panel.peer.name == "robot"
    scheme = endpoint.split(":")[0]
    assert panel.peer.transport == robot.peer.transport == scheme
    assert panel.capabilities.encrypted == (scheme in ("udp", "quic"))
    for one, other in ((panel, robot), (robot, panel)):
        one.latest.publish((1.0, 2.0, 3.5))
        value = other.latest.receive(10)
        assert (value["x"], value["z"], value.dtype) == (1.0, 3.5, VECTOR)
        assert other.latest.newest() is None

        items = np.zeros(5_000, VECTOR)
        items["y"] = np.arange(5_000)
        assert one.frames.send(items, (7, 8, 9)) == 0
        frame = other.frames.receive(10)
        assert frame.number == 0 and frame.header["y"] == 8
        assert frame.items.dtype == VECTOR and np.array_equal(frame.items, items)
        assert 0 <= frame.age < 10 and frame.skipped == (0, 0, 0)
        frame.items["x"] = 1  # it may be written
        assert one.frames.send([], (0, 0, 0), number=7) == 7
        assert one.frames.send(items[::-2], (0, 0, 0)) == 8
        assert len(other.frames.receive(10).items) == 0
        assert np.array_equal(other.frames.receive(10).items, items[::-2])

        one.messages.send(b"")
        one.messages.send(b"x" * 16_384)
        assert other.messages.receive(10) == b""
        assert other.messages.receive(10) == b"x" * 16_384

        blob = np.random.default_rng(1).bytes(1 << 20)
        steps: list[tuple[int, int]] = []
        sender = in_background(lambda one=one: one.bulk.send(blob, lambda *now: steps.append(now)))
        assert other.bulk.receive(20) == blob
        sender.join(10)
        assert steps[-1] == (1 << 20, 1 << 20)
        assert steps == sorted(set(steps))
    stats = panel.stats()
    assert stats.sent_bytes > 1_5_000 and stats.received_bytes > 1_5_000


@pytest.mark.parametrize(
    "item, items",
    [
        ("<u4", np.arange(5, dtype="<u4")),
        ("u1", np.arange(5, dtype="u1")),
        (("<f8", (3,)), np.arange(15.0).reshape(5, 3)),
        (("<f4", (4, 16)), np.ones((2, 4, 16), "<f4")),
        (np.dtype([("at", "<f4", (3,)), ("ring", "u1")], align=True), None),
    ],
)
def test_items_of_any_dtype(pair: MakePair, item: object, items: np.ndarray | None) -> None:
    protocol = tt.Protocol("items/1", item=item)
    if items is None:
        items = np.array([((1, 2, 3), 4)] * 7, item)
    one, other = pair("tcp://127.0.0.1:0", protocol)
    one.frames.send(items)
    frame = other.frames.receive(10)
    assert frame.header is None and frame.items.dtype == items.dtype
    assert np.array_equal(frame.items, items)


def test_data_of_another_shape_is_refused(pair: MakePair) -> None:
    shapes = tt.Protocol("shapes/1", latest=("<f4", (3,)), item="<i4")
    one, other = pair("tcp://127.0.0.1:0", shapes, max_frame=50)
    with pytest.raises(ValueError, match=r"a value has the shape \(3,\), and \(2,\) is given"):
        one.latest.publish([1, 2])
    with pytest.raises(TypeError, match="None is given"):
        one.latest.publish(None)
    with pytest.raises(TypeError, match="no header"):
        one.frames.send([1], header=3)
    with pytest.raises(TypeError, match="same_kind"):
        one.frames.send(np.array([1.5]))
    with pytest.raises(ValueError, match=r"items have the shape \('n',\)"):
        one.frames.send([[1, 2]])
    vectors, _ = pair("inproc:shapes", tt.Protocol("vectors/1", item=("<f4", (3,))))
    with pytest.raises(ValueError, match=r"items have the shape \('n', 3\), and \(5, 2\) is given"):
        vectors.frames.send(np.ones((5, 2), "<f4"))
    with pytest.raises(ValueError, match="a frame of 51 items: at most 50 may be sent"):
        one.frames.send(range(51))
    with pytest.raises(ValueError, match="longer than 16384 bytes"):
        one.messages.send(b"x" * 16_385)
    one.frames.send([1], number=5)
    with pytest.raises(ValueError, match="frame 4 cannot follow frame 5: frame numbers rise"):
        one.frames.send([1], number=4)
    # The link is as good as before.
    one.frames.send([2])
    assert [other.frames.receive(10).number for _ in range(2)] == [5, 6]


def test_a_large_frame_waits_for_its_reader(endpoint: str, pair: MakePair) -> None:
    one, other = pair(endpoint)
    items = np.zeros(500_000, VECTOR)
    items["z"] = np.arange(500_000)
    sender = in_background(lambda: one.frames.send(items, (0, 0, 0)))
    frame = other.frames.receive(30)
    sender.join(10)
    assert np.array_equal(frame.items, items)


def test_the_newest_value_is_read(pair: MakePair) -> None:
    one, other = pair("tcp://127.0.0.1:0", tt.Protocol("numbers/1", latest="<u4"))
    for number in range(1000):
        one.latest.publish(number)
    last = -1
    while last < 999:
        value = int(other.latest.receive(10))
        assert value > last
        last = value


def test_a_slow_reader_gets_the_newest_frames(endpoint: str, pair: MakePair) -> None:
    one, other = pair(endpoint)
    other.frames.keep_last(2)
    items = np.zeros(1000, VECTOR)
    for _ in range(500):
        one.frames.send(items, (0, 0, 0))
    one.messages.send(b"all sent")
    other.messages.receive(10)
    # The frames may still be on its way.
    deadline = time.monotonic() + 10
    while other.stats().skipped.replaced < 498 and time.monotonic() < deadline:
        time.sleep(0.01)
    frames = [other.frames.receive(10) for _ in range(2)]
    assert [frame.number for frame in frames] == [498, 499]
    assert frames[0].skipped == tt.Skipped(498, 0, 0) and frames[0].age > 0
    with pytest.raises(tt.TransportTimeout):
        other.frames.receive(0)
    other.frames.keep_last(lifespan=0.0)
    one.frames.send(items, (0, 0, 0))
    with pytest.raises(tt.TransportTimeout):
        other.frames.receive(0.2)
    assert other.stats().skipped.expired == 1
    with pytest.raises(ValueError, match="give 1 or more"):
        other.frames.keep_last(0)


def test_loops_end_when_the_peer_closes(endpoint: str, pair: MakePair) -> None:
    one, other = pair(endpoint)
    for number in range(3):
        one.frames.send([(number, 0, 0)], (0, 0, 0))
    in_background(lambda: one.close(7, "the shift is over"))
    assert [frame.items["x"][0] for frame in other.frames] == [0, 1, 2]
    assert list(other.messages) == []
    with pytest.raises(tt.LinkClosed, match="panel closed the link: the shift is over") as closed:
        other.frames.receive(10)
    assert (closed.value.code, closed.value.reason) == (7, "the shift is over")


def test_closing_ends_every_wait_of_this_side(endpoint: str, pair: MakePair) -> None:
    one, _other = pair(endpoint)
    waits = [one.latest.receive, one.frames.receive, one.messages.receive, one.bulk.receive]
    ends: list[str] = []

    def wait(act: object) -> None:
        try:
            act()  # type: ignore[operator]
        except tt.LinkClosed as closed:
            ends.append(str(closed))

    threads = [in_background(lambda act=act: wait(act)) for act in waits]
    time.sleep(0.1)
    one.close(0, "done")
    for thread in threads:
        thread.join(5)
    assert ends == ["this side has closed the link"] * 4
    for act in (lambda: one.latest.publish((0, 0, 0)), lambda: one.frames.send([], (0, 0, 0)), *waits):
        with pytest.raises(tt.LinkClosed):
            act()
    one.close()


def test_closing_a_listener_ends_accept_and_frees_the_address() -> None:
    listener = tt.listen("tcp://127.0.0.1:0", ROBOT)
    with pytest.raises(tt.TransportTimeout, match="no peer connected to tcp://127.0.0.1"):
        listener.accept(0.05)
    closing = threading.Timer(0.1, listener.close)
    closing.start()
    with pytest.raises(tt.TransportError, match="the listener is closed"):
        listener.accept()
    closing.join(10)
    tt.listen(listener.endpoint, ROBOT).close()
    with tt.listen(["tcp://127.0.0.1:0", "inproc:here"], ROBOT) as both:
        assert both.endpoints[1] == "inproc:here"
        with pytest.raises(tt.ConnectError, match="it is in use") as in_use:
            tt.listen("inproc:here", ROBOT)
    assert in_use.value.may_pass


def test_a_cancelled_blob_is_told(pair: MakePair) -> None:
    one, other = pair("tcp://127.0.0.1:0")

    def stop(sent: int, _length: int) -> None:
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        one.bulk.send(bytes(1 << 26), stop)
    sender = in_background(lambda: one.bulk.send(b"next"))
    with pytest.raises(tt.TransportError, match="panel gave up a blob after"):
        other.bulk.receive(20)
    assert other.bulk.receive(20) == b"next"
    sender.join(10)


def test_a_blob_that_is_too_long_is_refused_and_the_next_one_comes(pair: MakePair) -> None:
    one, other = pair("tcp://127.0.0.1:0", max_blob=1000)
    sender = in_background(lambda: [one.bulk.send(bytes(1001)), one.bulk.send(bytes(1000))])
    with pytest.raises(tt.TransportError, match="a blob of 1001 bytes came, and at most 1000 are taken"):
        other.bulk.receive(10)
    assert other.bulk.receive(10) == bytes(1000)
    sender.join(10)
