"""What listens does so on this machine alone; what is installed and what the gates ask for is stated.

That nothing is fetched and no text is run as code is asked by ruff (banned-api) and test_architecture.py.
"""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "taichi_erosion"


def test_whatever_the_viewer_serves_is_bound_to_this_machine() -> None:
    text = (PACKAGE / "recording" / "viewer.py").read_text(encoding="utf-8")
    commands = re.findall(r"\[binary,[^\]]*\]", text)
    assert commands
    assert all('"--bind", LOOPBACK' in command for command in commands)
    assert 'LOOPBACK = "127.0.0.1"' in text


def test_every_pin_is_one_version() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    version = r"[A-Za-z0-9_.-]+==[0-9][A-Za-z0-9.]*"
    assert all(re.fullmatch(version + r"(; python_version (<|>=) \"3\.\d+\")?", pin) for pin in pins)
    # a package of two versions has each for other Pythons
    names = [(pin.partition("==")[0].lower().replace("_", "-"), pin.partition(";")[2]) for pin in pins]
    assert len(set(names)) == len(names)


def test_the_gates_ask_for_no_secret() -> None:
    text = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert not re.search(r"secret|token|password|sudo", text, re.IGNORECASE)
