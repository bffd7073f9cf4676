"""Nothing is fetched while a command runs, and what listens does so on this machine alone."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "taichi_erosion"
SPEAKING = {"socket", "ssl", "http", "urllib", "requests", "httpx", "aiohttp", "ftplib", "smtplib", "xmlrpc"}
# who may speak, and of what: the viewer on the loopback interface, the name of this machine in a ledger, and
# names of files quoted in the mark of what this program wrote
ALLOWED = {
    "recording/viewer.py": {"socket", "urllib"},
    "campaign/ledger.py": {"socket"},
    "core/files.py": {"urllib"},
}
EFFECT_FILES = "core/effect_loading.py"  # own effects are code that the user names (docs/trust.md)
RUNNING_CODE = {"eval", "exec", "compile", "__import__"}


def trees() -> dict[str, ast.Module]:
    """Every file of the package that holds one of the words that matter, parsed."""
    words = re.compile("|".join(SPEAKING | RUNNING_CODE | {"pickle", "os.system", "popen"}))
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    return {
        path.relative_to(PACKAGE).as_posix(): ast.parse(text)
        for path, text in texts.items()
        if words.search(text)
    }


def imported(tree: ast.AST) -> set[str]:
    """Packages that a file imports."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {name.name.partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found


def called(tree: ast.AST) -> set[str]:
    """Functions that a file calls, as written."""
    return {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}


def test_no_room_speaks_to_a_network() -> None:
    spoken = {place: imported(tree) & SPEAKING for place, tree in trees().items()}
    assert {place: found for place, found in spoken.items() if found} == ALLOWED


def test_no_text_is_run_as_code_and_no_stranger_is_unpickled() -> None:
    for place, tree in trees().items():
        calls = called(tree)
        assert not calls & RUNNING_CODE or place == EFFECT_FILES, place
        assert not calls & {"pickle.load", "pickle.loads"}
        assert not {call for call in calls if call.endswith(("os.system", "os.popen"))}, place


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
