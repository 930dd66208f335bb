"""Errors: their kinds, and the text of the crate."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROBOT, MakePair

import trimaran_transport as tt


def test_nobody_listens() -> None:
    with pytest.raises(tt.ConnectError, match="within .* is a peer running there") as error:
        tt.connect("inproc:nobody", ROBOT, timeout=0.3)
    assert error.value.may_pass and len(error.value.causes) > 1
    assert isinstance(error.value, tt.TransportError)


@pytest.mark.parametrize("scheme", ["tcp", "ws", "udp", "quic", "inproc"])
def test_another_protocol_is_refused(scheme: str, known: tuple[tt.Keys, tt.Keys]) -> None:
    panel, robot = known
    at = "inproc:refuses" if scheme == "inproc" else f"{scheme}://127.0.0.1:0"
    with tt.listen(at, ROBOT, keys=robot, peers=[panel.public]) as listener:
        other = tt.Protocol("toaster/2")
        with pytest.raises(tt.ConnectError, match="toaster/2") as error:
            tt.connect(listener.endpoint, other, timeout=0.5, keys=panel, peers=[robot.public])
    assert error.value.may_pass
    # The handshake of TLS tells only what the listener does not have.
    told = "but not toaster/2" if scheme == "quic" else "speaks robot/1, the connecting peer toaster/2"
    assert told in str(error.value)


def test_keys_are_needed_and_must_be_known(known: tuple[tt.Keys, tt.Keys]) -> None:
    panel, robot = known
    with pytest.raises(tt.ConnectError, match="keys") as error:
        tt.listen("quic://127.0.0.1:0", ROBOT)
    assert not error.value.may_pass
    stranger = tt.Keys.generate("stranger")
    for scheme in ("quic", "udp"):
        with tt.listen(f"{scheme}://127.0.0.1:0", ROBOT, keys=robot, peers=[panel.public]) as listener:
            with pytest.raises(tt.ConnectError):
                tt.connect(listener.endpoint, ROBOT, timeout=0.5, keys=stranger, peers=[robot.public])


def test_key_files_are_not_overwritten(tmp_path: Path) -> None:
    keys = tt.Keys.generate("robot")
    private, public = keys.save(tmp_path)
    assert (private.name, public.name) == ("robot.key", "robot.pub")
    assert private.stat().st_mode & 0o077 == 0
    with pytest.raises(tt.KeysError, match="keys are not overwritten"):
        keys.save(tmp_path)
    with pytest.raises(tt.KeysError, match="robot.pub"):
        tt.Keys.read(public)
    with pytest.raises(tt.KeysError, match="cannot read the keys") as missing:
        tt.PublicKeys.read(tmp_path / "nobody.pub")
    assert missing.value.causes[-1].startswith("No such file")
    with pytest.raises(ValueError, match="a name has 1 to"):
        tt.Keys.generate("no name")


def test_values_of_another_size_break_the_protocol(pair: MakePair) -> None:
    small, large = tt.Protocol("sizes/1", latest="<u4"), tt.Protocol("sizes/1", latest="<u8")
    for at in ("tcp://127.0.0.1:0", "inproc:sizes"):
        with tt.listen(at, small) as listener:
            one = tt.connect(listener.endpoint, large)
            other = listener.accept(10)
        one.latest.publish(1)
        with pytest.raises(tt.ProtocolError):
            other.latest.receive(10)


def test_mistakes_are_value_errors() -> None:
    for endpoint, text in [("tcp:there", "no transport"), ("tcp://there", "it has no port")]:
        with pytest.raises(ValueError, match=text):
            tt.connect(endpoint, ROBOT)
    with pytest.raises(ValueError, match="no endpoint is given"):
        tt.listen([], ROBOT)
    with pytest.raises(ValueError, match="unknown field `idle`"):
        tt.listen("inproc:x", ROBOT, options={"link": {"idle": 1}})
    with pytest.raises(ValueError, match="an item of 257 bytes is outside 1 to 256"):
        tt.listen("inproc:x", tt.Protocol("x/1", item=("u1", (257,))))
    with pytest.raises(ValueError, match="is no name of a protocol"):
        tt.listen("inproc:x", tt.Protocol("x" * 33))
    with pytest.raises(ValueError, match="a batch of 0 is outside 1 to 16384"):
        tt.listen("inproc:x", ROBOT, batch=0)
    with pytest.raises(ValueError, match="a timeout of -1"):
        tt.connect("inproc:x", ROBOT, timeout=-1)
    with pytest.raises(TypeError, match="Python objects"):
        tt.Protocol("x/1", latest=object)


def test_a_peer_that_is_dropped_is_lost(pair: MakePair) -> None:
    with tt.listen("tcp://127.0.0.1:0", ROBOT) as listener:
        one = tt.connect(listener.endpoint, ROBOT)
        other = listener.accept(10)
    del one
    with pytest.raises(tt.LinkLost, match="the connection to the peer was lost: it was closed"):
        other.frames.receive(10)


def test_a_timeout_leaves_the_link_as_it_was(pair: MakePair) -> None:
    one, other = pair("tcp://127.0.0.1:0")
    with pytest.raises(TimeoutError, match="nothing came from panel before the deadline"):
        other.messages.receive(0.05)
    one.messages.send(b"late")
    assert other.messages.receive(10) == b"late"


WAITS = {
    "receive": "link.frames.receive()",
    "accept": "listener.accept()",
    "connect": "tt.connect('tcp://127.0.0.1:1', P, timeout=60)",
    "send": "[link.messages.send(bytes(16_000)) for _ in range(10_000)]",
}


@pytest.mark.parametrize("wait", WAITS)
def test_ctrl_c_ends_a_wait(wait: str) -> None:
    program = f"""
import signal, threading, time, os
import trimaran_transport as tt
# A program in the background of a shell is begun deaf to it.
signal.signal(signal.SIGINT, signal.default_int_handler)
P = tt.Protocol("x/1")
listener = tt.listen("tcp://127.0.0.1:0", P)
link = tt.connect(listener.endpoint, P)
other = listener.accept(10)
begun = []
def interrupt():
    time.sleep(0.5)
    begun.append(time.monotonic())
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt).start()
try:
    {WAITS[wait]}
except KeyboardInterrupt:
    print("interrupted", time.monotonic() - begun[0])
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50)
    assert ended.returncode == 0, ended.stderr
    word, seconds = ended.stdout.split()
    # The wait itself would last for much longer.
    assert word == "interrupted" and float(seconds) < 5


def test_other_threads_run_during_a_wait(pair: MakePair) -> None:
    one, _ = pair("tcp://127.0.0.1:0")
    from conftest import in_background

    waiting = in_background(lambda: pytest.raises(TimeoutError, one.frames.receive, 1))
    begun, steps = time.monotonic(), 0
    while waiting.is_alive() and time.monotonic() - begun < 20:
        steps += 1
    assert steps > 100


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_process_is_told_why_it_has_no_links(pair: MakePair) -> None:
    pair("tcp://127.0.0.1:0")
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            tt.connect("inproc:x", ROBOT, timeout=0.1)
        except BaseException as error:  # It may not return into pytest.
            os.write(write, str(error).encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert b"forked process" in os.read(read, 1000)
