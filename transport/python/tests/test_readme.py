"""The examples of the README run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def told(example: str) -> str:
    ended = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True, timeout=60)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_the_robot_and_its_panel() -> None:
    first, second = told(EXAMPLES[0]).splitlines()
    skipped = r"Skipped\(replaced=[01], expired=0, incomplete=0\)"
    assert re.fullmatch(rf"frame 1: 2000 points, 0\.\d+ s old, {skipped}", first), first
    assert second == "b'done'"


def test_one_sender_and_the_keys() -> None:
    assert [told(example) for example in EXAMPLES[1:]] == ["1000.0\n", "0.5\n"]
