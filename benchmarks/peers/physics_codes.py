"""How each code is given a start and what comes back: ours in this process, the others as programs."""

import os
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import sqrt
from pathlib import Path

import numpy as np
from scipy.optimize import root_scalar

from benchmarks.peers.cases import Floats, Soil
from benchmarks.peers.codes import LAMMPS, LIGGGHTS, NEW_LAMMPS, TIME_LIMIT, Peer, missing
from benchmarks.peers.make_cases import FLOOR_MARGIN, write_grains, write_include
from benchmarks.peers.physics_cases import BED_SIDE, ROLLING_DAMPING, ROUGH, Failed, Start, shear_effective
from benchmarks.peers.physics_column import (
    BOX_D,
    Column,
    column_numbers,
    column_soil,
    lammps_rolling,
    our_columns,
    surface_energy,
)
from benchmarks.peers.physics_measures import Rest
from benchmarks.setups import bed_setup
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.grains.materials import damping_ratio
from taichi_erosion.simulation import advance, assemble, failure_of, snapshot

DECKS = Path(__file__).parent
HEADROOM = 5e-3  # m, above the highest grain
AFTER_LAST_STEP = "Neighbor history overflow"  # LAMMPS of 2021 says so of the pair when its path is done
DUMP_HEAD = 9  # lines of a dump before the grains
# a(e) of LAMMPS' damping tsuji, its manual on pair_style granular; highest power first
LAMMPS_TSUJI = (4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728)
ROLLING_SPRING = 3.0  # N m-1 in LAMMPS: 2.25 k_n mu_r^2 of the elastic-plastic law under five weights
ROLLING_DAMPER = 1.8e-3  # kg s-1 in LAMMPS: ROLLING_DAMPING of the critical value at that spring


@dataclass(frozen=True)
class Code:
    """One contestant: how it runs beds and columns from the same starts."""

    name: str
    missing: str  # why it cannot run here; empty if it can
    beds: Callable[[Sequence[Start], int], list[Rest]]  # starts and steps
    columns: Callable[
        [Column, Sequence[Start]], list[Rest] | None
    ]  # none where another law of the same code comes nearer


@dataclass(frozen=True)
class Damping:
    """Damping of LAMMPS: its law and the inputs of grains and walls, as its decks name them."""

    damping: str
    restitution: float  # entered for grains [1]
    restitution_wall: float  # entered for walls [1]


def our_setup(start: Start) -> Setup:
    """A start over a floor, periodic along x and y."""
    case = asdict(ROUGH) | {"position": start.position, "period": (BED_SIDE, BED_SIDE)}
    setup = bed_setup(case)
    return replace(setup, grains=replace(setup.grains, velocity=start.velocity))


def our_beds(starts: Sequence[Start], steps: int) -> list[Rest]:
    """Beds in our code, as one ensemble in double precision."""
    setups = list(map(our_setup, starts))
    sim = assemble(setups, Laws(rolling="elastic_plastic"), Numerics("cpu", 1, "f64"))
    advance(sim, [steps * ROUGH.time_step] * len(setups))
    for replica in range(len(setups)):
        if fault := failure_of(sim, replica):
            raise Failed(f"ours, seed {replica}: {fault}")
    states = [snapshot(sim, replica) for replica in range(len(setups))]
    return [Rest(state.position, state.velocity, state.spin) for state in states]


def called(peer: Peer, deck: str, numbers: Mapping[str, object], folder: Path) -> Path:
    """Run a deck of a peer in a folder; its log."""
    write_include(folder / "case.inc", numbers)
    log = folder / "log"
    command = [peer.binary, "-in", str(DECKS / f"{deck}.{peer.suffix}"), "-log", str(log)]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        command, cwd=folder, env=environment, timeout=TIME_LIMIT, capture_output=True, text=True, check=False
    )
    if done.returncode != 0 and not (log.exists() and AFTER_LAST_STEP in log.read_text(errors="replace")):
        tail = (done.stdout + done.stderr).strip().splitlines()[-5:]
        raise Failed(f"{peer.name}, {deck}: " + " / ".join(tail))
    return log


def peer_rest(peer: Peer, deck: str, start: Start, soil: Soil, numbers: Mapping[str, object]) -> Rest:
    """One start in a peer."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        low, high = sides(deck, start, soil)
        write_grains(folder / "grains.data", start.position, low, high, start.velocity, soil)
        called(peer, deck, soil_numbers(soil, peer) | dict(numbers), folder)
        table = np.loadtxt(folder / "end.dump", skiprows=DUMP_HEAD, ndmin=2)
    if len(table) != len(start.position):
        raise Failed(f"{peer.name}, {deck}: {len(start.position) - len(table)} grains are lost")
    return Rest(table[:, 1:4], table[:, 4:7], table[:, 7:10])


def sides(deck: str, start: Start, soil: Soil) -> tuple[Floats, Floats]:
    """Low and high corner of the box of a deck [m]."""
    top = float(start.position[:, 2].max()) + HEADROOM
    if deck == "physics_bed":
        return np.array([0.0, 0.0, -FLOOR_MARGIN]), np.array([BED_SIDE, BED_SIDE, top])
    wide = BOX_D * soil.diameter
    return np.array([-wide, -wide, -FLOOR_MARGIN]), np.array([wide, wide, top])


def soil_numbers(soil: Soil, peer: Peer) -> dict[str, object]:
    """Variables of every deck.

    LAMMPS of 2021 mixes the modulus of a wall as E / (2 (1 - nu)): a grain on its floor sank to 0.844 of
    Hertz' depth, (1 + nu)^(-2/3). Its input is E / (1 + nu), and 8 G* of wall and grain outright.
    LAMMPS of 2025 mixes it as the modulus of two grains.
    """
    young = soil.young if peer == NEW_LAMMPS else soil.young / (1.0 + soil.poisson)
    wall: dict[str, object] = {"young_wall": young, "shear_wall": 8.0 * shear_effective(soil)}
    return asdict(soil) | wall


def peer_beds(starts: Sequence[Start], steps: int, peer: Peer, words: Mapping[str, object]) -> list[Rest]:
    """Beds in a peer."""
    numbers = {"steps": steps} | dict(words)
    return [peer_rest(peer, "physics_bed", start, ROUGH, numbers) for start in starts]


def peer_columns(
    column: Column, starts: Sequence[Start], peer: Peer, words: Mapping[str, object]
) -> list[Rest]:
    """What becomes of some starts in the apparatus of the columns in a peer."""
    numbers, soil = column_numbers(column) | dict(words), column_soil(column)
    return [peer_rest(peer, "physics_column", start, soil, numbers) for start in starts]


def lammps_damping(restitution: float, peer: Peer) -> Damping:
    """What LAMMPS must be told so that grains part from each other and from walls with this restitution.

    The law `coeff_restitution` of 2025 gives back what is entered. That of 2021 applies its polynomial to the
    input of walls again at the start of every run: with an input of 0.9 a grain left the plate with that in
    the first run of a deck, with 0.58 in the second. The input is right for the second run, the collapse.
    """
    if peer == NEW_LAMMPS:
        return Damping("coeff_restitution", restitution, restitution)
    entered = lammps_restitution(restitution)
    return Damping("tsuji", entered, lammps_wall_restitution(entered))


def lammps_restitution(restitution: float) -> float:
    """Input of LAMMPS for which grains part with this restitution [1].

    Tsuji's damping a sqrt(m k) d^(1/4) gives back exp(-pi b / sqrt(1 - b^2)), b = a / sqrt(5). The polynomial
    of LAMMPS says a = 0.253 for 0.6 where 0.359 is right: an impact gave back 0.70.
    """
    return lammps_wall_restitution(sqrt(5.0) * float(damping_ratio(np.array([restitution]))[0]))


def lammps_wall_restitution(found: float) -> float:
    """Input of LAMMPS for a wall: where its polynomial has this value [1]."""
    return root_scalar(lambda entered: np.polyval(LAMMPS_TSUJI, entered) - found, bracket=(0.0, 1.0)).root


def lammps_columns(column: Column, starts: Sequence[Start], peer: Peer) -> list[Rest] | None:
    """The same in LAMMPS; that of 2025 refuses damping by restitution where grains adhere."""
    if column.sticky and peer == NEW_LAMMPS:
        return None
    damping = lammps_damping(column_soil(column).restitution, peer)
    normal = {"normal": lammps_normal(column, damping.restitution)}
    return peer_columns(column, starts, peer, asdict(damping) | normal | lammps_rolling(column))


def lammps_normal(column: Column, restitution: float) -> str:
    """The normal law between grains in LAMMPS."""
    soil = column_soil(column)
    elastic = f"{soil.young!r} {restitution!r} {soil.poisson!r}"
    return f"jkr {elastic} {surface_energy(column)!r}" if column.sticky else f"hertz/material {elastic}"


def liggghts_columns(column: Column, starts: Sequence[Start], peer: Peer, rolling: str) -> list[Rest] | None:
    """The same in LIGGGHTS with the rolling law that comes nearest to ours, or with none; it has no JKR."""
    if rolling != column.twin or column.sticky:
        return None
    return peer_columns(column, starts, peer, {"rolling": "off" if column.rolls_freely else rolling})


def lammps_code(peer: Peer) -> Code:
    """LAMMPS with a rolling spring like ours under five weights."""
    rolling = {"rolling_spring": ROLLING_SPRING, "rolling_damper": ROLLING_DAMPER}
    words = asdict(lammps_damping(ROUGH.restitution, peer)) | rolling
    return Code(
        peer.name,
        missing(peer),
        beds=partial(peer_beds, peer=peer, words=words),
        columns=partial(lammps_columns, peer=peer),
    )


def liggghts_code(peer: Peer, rolling: str) -> Code:
    """LIGGGHTS with one of its rolling laws."""
    words = {"rolling": rolling, "rolling_damping": ROLLING_DAMPING}
    return Code(
        f"{peer.name} {rolling}",
        missing(peer),
        beds=partial(peer_beds, peer=peer, words=words),
        columns=partial(liggghts_columns, peer=peer, rolling=rolling),
    )


def contestants() -> list[Code]:
    """All codes, ours first; LIGGGHTS with the rolling law that is ours, and with its stiffer one."""
    return [
        Code("ours", "", our_beds, our_columns),
        lammps_code(LAMMPS),
        lammps_code(NEW_LAMMPS),
        *(liggghts_code(LIGGGHTS, rolling) for rolling in ("epsd", "epsd2")),
    ]
