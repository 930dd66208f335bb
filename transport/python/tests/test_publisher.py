"""One sender, many subscribers."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROBOT, VECTOR, MakePair, quietly

import trimaran_transport as tt

ITEMS = np.zeros(1000, VECTOR)


def test_each_subscriber_gets_every_frame(pair: MakePair) -> None:
    links = [pair(at) for at in ("tcp://127.0.0.1:0", "inproc:many", "ws://127.0.0.1:0")]
    publisher = tt.Publisher(ROBOT)
    for ours, _ in links:
        publisher.subscribe(ours, "wait")
    for number in range(20):
        assert publisher.publish(ITEMS, (number, 0, 0)) == (number, [])
        for _, theirs in links:
            frame = theirs.frames.receive(10)
            assert (frame.number, frame.header["x"]) == (number, number)
            assert np.array_equal(frame.items, ITEMS)
    stats = publisher.subscribers()
    assert [link for link, _ in stats] == [ours for ours, _ in links]
    assert [counts.sent for _, counts in stats] == [20] * 3
    ours, theirs = links[0]
    with pytest.raises(tt.TransportError, match="a publisher sends the frames of this link"):
        ours.frames.send(ITEMS, (0, 0, 0))
    assert publisher.unsubscribe(ours) and not publisher.unsubscribe(ours)
    assert ours.frames.send(ITEMS, (0, 0, 0)) == 20
    assert theirs.frames.receive(10).number == 20
    with pytest.raises(ValueError, match="frame numbers rise"):
        publisher.publish(ITEMS, (0, 0, 0), number=3)


def test_a_subscriber_that_comes_late_gets_the_last_frame(pair: MakePair) -> None:
    ours, theirs = pair("tcp://127.0.0.1:0")
    publisher = tt.Publisher(ROBOT)
    publisher.publish(ITEMS, (1, 0, 0))
    publisher.publish(ITEMS, (2, 0, 0))
    publisher.subscribe(ours)
    assert theirs.frames.receive(10).header["x"] == 2


def test_a_slow_subscriber_skips_to_the_newest(pair: MakePair) -> None:
    ours, theirs = pair("tcp://127.0.0.1:0")
    publisher = tt.Publisher(ROBOT)
    publisher.subscribe(ours, "skip")
    many = np.zeros(50_000, VECTOR)
    for number in range(20):
        publisher.publish(many, (number, 0, 0))
    [(_, counts)] = publisher.subscribers()
    assert counts.skipped > 0 and counts.is_behind
    numbers = []
    while not numbers or numbers[-1] < 19:
        numbers.append(theirs.frames.receive(20).number)
    assert len(numbers) < 20


def test_a_slow_subscriber_is_disconnected(pair: MakePair) -> None:
    ours, theirs = pair("tcp://127.0.0.1:0")
    publisher = tt.Publisher(ROBOT)
    publisher.subscribe(ours, "disconnect")
    many = np.zeros(50_000, VECTOR)
    left = [gone for _ in range(20) for gone in publisher.publish(many, (0, 0, 0)).left]
    assert left == [(ours, "it was too slow for the frames published")]
    assert publisher.subscribers() == []
    quietly(ours.close)
    with pytest.raises((tt.LinkLost, tt.LinkClosed)):
        while True:
            theirs.frames.receive(20)


def test_a_subscribed_link_is_closed_with_its_reason(pair: MakePair) -> None:
    ours, theirs = pair("tcp://127.0.0.1:0")
    publisher = tt.Publisher(ROBOT)
    publisher.subscribe(ours)
    publisher.publish(ITEMS, (1, 0, 0))
    ours.close(4, "enough")
    assert theirs.frames.receive(10).number == 0
    with pytest.raises(tt.LinkClosed, match="enough"):
        theirs.frames.receive(10)
    assert publisher.publish(ITEMS, (2, 0, 0)).left == [] and publisher.subscribers() == []


def test_a_link_of_another_protocol_is_refused(pair: MakePair) -> None:
    ours, _ = pair("tcp://127.0.0.1:0", tt.Protocol("other/1"))
    publisher = tt.Publisher(ROBOT)
    with pytest.raises(ValueError, match="other/1"):
        publisher.subscribe(ours)
    with pytest.raises(ValueError, match='give "wait", "skip" or "disconnect"'):
        tt.Publisher(tt.Protocol("other/1")).subscribe(ours, "never")  # type: ignore[arg-type]
