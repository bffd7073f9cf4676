"""How each code is run on a case, pinned to given cores, and what the machine did meanwhile."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks.peers.peer_log import last_run

DECKS = Path(__file__).parent
CASES = DECKS / "cases"
ROOT = DECKS.parents[1]
TIME_LIMIT = 600.0  # s for one run; the longest takes about a minute on a slow core


@dataclass(frozen=True)
class Workload:
    """A case and the window that is timed."""

    case: str  # name of its files
    deck: str  # "bed" or "pile"
    warm_up: int  # steps before the window
    steps: int


@dataclass(frozen=True)
class Figures:
    """What a code reports of one window."""

    grain_steps_per_s: float
    contacts_per_grain: float  # grain on grain, each contact counted at both grains, at the end of the window
    rebuilds: int  # of the neighbour list


@dataclass(frozen=True)
class Peer:
    """A program we compare with."""

    name: str
    binary: str
    suffix: str  # of its decks and logs
    package: str  # in Debian


PEERS = (Peer("LAMMPS", "lmp", "lmp", "lammps"), Peer("LIGGGHTS", "liggghts", "lig", "liggghts"))


@dataclass(frozen=True)
class Code:
    """One contestant."""

    name: str
    missing: str  # why it cannot run here; empty if it can
    run: Callable[[Workload, Sequence[int]], Figures]


def machine_busy() -> float:
    """Time all cores of this machine have worked, or were taken away by the host, since boot [s]."""
    fields = Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]
    user, nice, system, _idle, _waiting, interrupt, soft_interrupt, stolen = map(int, fields)
    return (user + nice + system + interrupt + soft_interrupt + stolen) / os.sysconf("SC_CLK_TCK")


def children_busy() -> float:
    """Processor time of all finished child processes [s]."""
    spent = os.times()
    return spent.children_user + spent.children_system


def foreign_share(work: Callable[[], Figures]) -> tuple[Figures, float]:
    """Figures of some work in child processes, and the share of the machine that others used meanwhile [1].

    The whole machine counts, not only the pinned cores: neighbours share caches, memory and often the core.
    """
    start, busy, own = time.perf_counter(), machine_busy(), children_busy()
    figures = work()
    foreign = (machine_busy() - busy) - (children_busy() - own)
    available = (time.perf_counter() - start) * (os.cpu_count() or 1)
    return figures, max(0.0, foreign / available)


def pinned(cores: Sequence[int], command: Sequence[str], folder: Path) -> str:
    """Output of a command that may use the given cores only."""
    pin = ["taskset", "-c", ",".join(map(str, cores))]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*pin, *command], cwd=folder, env=environment, timeout=TIME_LIMIT, capture_output=True, text=True
    )
    if done.returncode != 0:
        tail = (done.stdout + done.stderr).strip().splitlines()[-5:]
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: " + "\n".join(tail))
    return done.stdout


def mpi_launch(processes: int) -> list[str]:
    """Open MPI's launcher with one process per core; nothing for a single process."""
    if processes == 1:
        return []
    as_root = ["--allow-run-as-root"] if os.geteuid() == 0 else []
    return ["mpirun", *as_root, "--bind-to", "core", "-np", str(processes)]


def peer_log(peer: Peer, case: str) -> Path:
    """Where a peer logs its runs of a case; only the newest is kept."""
    return CASES / f"{case}.{peer.suffix}.log"


def peer_figures(workload: Workload, cores: Sequence[int], peer: Peer) -> Figures:
    """Figures of LAMMPS or LIGGGHTS."""
    log = peer_log(peer, workload.case)
    deck = DECKS / f"{workload.deck}.{peer.suffix}"
    window = {workload.deck: workload.case, "warm_up": str(workload.warm_up), "steps": str(workload.steps)}
    variables = [word for name, value in window.items() for word in ("-var", name, value)]
    # no "-screen none": LIGGGHTS 3.8 then crashes when it reads a mesh
    files = ["-in", str(deck), "-log", str(log)]
    pinned(cores, [*mpi_launch(len(cores)), peer.binary, *files, *variables], CASES)
    run = last_run(log.read_text())
    return Figures(run.grain_steps_per_s, run.columns["contacts"], run.rebuilds)


def peer_version(peer: Peer, case: str) -> str:
    """How a peer names itself in its log of a case."""
    return peer_log(peer, case).read_text().partition("\n")[0].strip()


def our_figures(workload: Workload, cores: Sequence[int], precision: str) -> Figures:
    """Figures of taichi_erosion."""
    case = CASES / f"{workload.case}.npz"
    words = [workload.deck, str(case), str(workload.steps), str(len(cores)), precision]
    output = pinned(cores, [sys.executable, "-m", "benchmarks.peers.ours", *words], ROOT)
    return Figures(**json.loads(output.strip().splitlines()[-1]))


def peer_code(peer: Peer) -> Code:
    """LAMMPS or LIGGGHTS, if installed."""
    missing = "" if shutil.which(peer.binary) else f"{peer.binary} not found (Debian package {peer.package})"
    return Code(peer.name, missing, partial(peer_figures, peer=peer))


def ours(precision: str) -> Code:
    """taichi_erosion in one precision, if it can be timed yet."""
    found = importlib.util.find_spec("taichi_erosion.benchmark") is not None
    missing = "" if found else "taichi_erosion.benchmark not found"
    return Code(f"ours {precision}", missing, partial(our_figures, precision=precision))


def contestants() -> list[Code]:
    """All codes of the comparison, ours first."""
    return [ours("f32"), ours("f64"), *map(peer_code, PEERS)]
