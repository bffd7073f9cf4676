"""How each code is given a start and what comes back: ours in this process, the others as programs."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.peers.codes import PEERS, TIME_LIMIT, Peer
from benchmarks.peers.make_cases import FLOOR_MARGIN, write_grains, write_include
from benchmarks.peers.physics_cases import (
    BED_SIDE,
    ROLLING_DAMPING,
    ROUGH,
    SETTLE_STEPS,
    SHEAR_EFFECTIVE,
    SPREAD_STEPS,
    TUBE_RADIUS,
    Start,
    sticky_energy,
)
from benchmarks.peers.physics_measures import Rest
from taichi_erosion.benchmark.setups import bed_setup, contact_table, floor, grain_table
from taichi_erosion.core.setup import Laws, Numerics, PrimitiveKind, PrimitiveTable, Setup, Surface
from taichi_erosion.simulation import advance, assemble, failure, remove_surface, snapshot

DECKS = Path(__file__).parent
HEADROOM = 5e-3  # m, above the highest grain
PILE_ROOM = 60e-3  # m, half the side of the open box of a pile
AFTER_LAST_STEP = "Neighbor history overflow"  # LAMMPS of 2021 says so of the pair when its path is done
DUMP_HEAD = 9  # lines of a dump before the grains
# Tsuji's damping a sqrt(m k) d^(1/4) gives back exp(-pi b / sqrt(1 - b^2)), b = a / sqrt(5). Told 0.6, the
# polynomial of LAMMPS says a = 0.253 instead of 0.359, and an impact gives back 0.70; told this, 0.60
RESTITUTION_TOLD = 0.48
ROLLING_SPRING = 3.0  # N m-1 in LAMMPS: 2.25 k_n mu_r^2 of the elastic-plastic law under five weights
ROLLING_DAMPER = 1.8e-3  # kg s-1 in LAMMPS: ROLLING_DAMPING of the critical value at that spring


class Failed(Exception):
    """A code did not run to its end."""


@dataclass(frozen=True)
class Code:
    """One contestant: how it runs beds and columns from the same starts."""

    name: str
    missing: str  # why it cannot run here; empty if it can
    beds: Callable[[Sequence[Start], int], list[Rest]]  # starts and steps
    piles: Callable[[Sequence[Start]], list[Rest]]
    sticky_piles: Callable[[Sequence[Start]], list[Rest]] | None  # none where there is no JKR


def our_setup(start: Start) -> Setup:
    """A start over a floor, periodic along x and y."""
    case = asdict(ROUGH) | {"position": start.position, "period": (BED_SIDE, BED_SIDE)}
    setup = bed_setup(case)
    return replace(setup, grains=replace(setup.grains, velocity=start.velocity))


def our_column(start: Start, surface_energy: float) -> Setup:
    """A start in a tube; only grains stick to each other."""
    case = asdict(ROUGH)
    high = float(start.position[:, 2].max()) + HEADROOM
    tube = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, TUBE_RADIUS, 0.0, TUBE_RADIUS, high]])
    kinds = np.array([PrimitiveKind.PLANE, PrimitiveKind.REVOLVED], np.int32)
    contacts = replace(contact_table(case), surface_energy=np.array([surface_energy, 0.0, 0.0]))
    return Setup(
        grains=replace(grain_table(start.position, case), velocity=start.velocity),
        materials=("grain", "wall"),
        contacts=contacts,
        primitives=PrimitiveTable(kinds, np.array([0, 1], np.int32), np.concatenate([floor(), tube])),
        surfaces=(Surface("floor", 1), Surface("tube", 1)),
        time_step=ROUGH.time_step,
        gravity=(0.0, 0.0, -ROUGH.gravity),
    )


def our_rests(setups: Sequence[Setup], laws: Laws, steps: Sequence[int]) -> list[Rest]:
    """Run all starts as one ensemble in double precision; a surface named tube goes after the first steps."""
    sim = assemble(setups, laws, Numerics("cpu", 1, "f64"))
    done = 0
    for count in steps:
        if done:
            for replica in range(len(setups)):
                remove_surface(sim, replica, "tube")
        done += count
        advance(sim, [done * ROUGH.time_step] * len(setups))
    for replica in range(len(setups)):
        if fault := failure(sim, replica):
            raise Failed(f"ours, seed {replica}: {fault}")
    states = [snapshot(sim, replica) for replica in range(len(setups))]
    return [Rest(state.position, state.velocity, state.spin) for state in states]


def our_beds(starts: Sequence[Start], steps: int) -> list[Rest]:
    """Beds in our code."""
    return our_rests(list(map(our_setup, starts)), Laws(rolling="elastic_plastic"), [steps])


def our_piles(starts: Sequence[Start], surface_energy: float = 0.0) -> list[Rest]:
    """Piles in our code."""
    laws = Laws(normal="jkr" if surface_energy else "hertz", rolling="elastic_plastic")
    columns = [our_column(start, surface_energy) for start in starts]
    return our_rests(columns, laws, [SETTLE_STEPS, SPREAD_STEPS])


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


def peer_rest(peer: Peer, deck: str, start: Start, numbers: Mapping[str, object]) -> Rest:
    """One start in a peer."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        top = float(start.position[:, 2].max()) + HEADROOM
        low, high = np.array([0.0, 0.0, -FLOOR_MARGIN]), np.array([BED_SIDE, BED_SIDE, top])
        if deck == "physics_pile":
            low, high = (
                np.array([-PILE_ROOM, -PILE_ROOM, -FLOOR_MARGIN]),
                np.array([PILE_ROOM, PILE_ROOM, top]),
            )
        write_grains(folder / "grains.data", start.position, low, high, start.velocity)
        called(peer, deck, soil_numbers() | dict(numbers), folder)
        table = np.loadtxt(folder / "end.dump", skiprows=DUMP_HEAD, ndmin=2)
    if len(table) != len(start.position):
        raise Failed(f"{peer.name}, {deck}: {len(start.position) - len(table)} grains are lost")
    return Rest(table[:, 1:4], table[:, 4:7], table[:, 7:10])


def soil_numbers() -> dict[str, object]:
    """Variables of every deck.

    LAMMPS of 2021 mixes the modulus of a wall as E / (2 (1 - nu)): a grain on its floor sank to 0.844 of
    Hertz' depth, (1 + nu)^(-2/3). It is told E / (1 + nu), and 8 G* of wall and grain outright.
    """
    wall = {"young_wall": ROUGH.young / (1.0 + ROUGH.poisson), "shear_wall": 8.0 * SHEAR_EFFECTIVE}
    rolling = {"rolling_spring": ROLLING_SPRING, "rolling_damper": ROLLING_DAMPER}
    return asdict(ROUGH) | wall | rolling | {"rolling_damping": ROLLING_DAMPING}


def peer_beds(starts: Sequence[Start], steps: int, peer: Peer, words: Mapping[str, object]) -> list[Rest]:
    """Beds in a peer."""
    return [peer_rest(peer, "physics_bed", start, {"steps": steps} | dict(words)) for start in starts]


def peer_piles(starts: Sequence[Start], peer: Peer, words: Mapping[str, object]) -> list[Rest]:
    """Piles in a peer; `words` hold the normal law of LAMMPS."""
    times = {"tube_radius": TUBE_RADIUS, "settle": SETTLE_STEPS, "steps": SPREAD_STEPS}
    return [peer_rest(peer, "physics_pile", start, times | dict(words)) for start in starts]


def quoted(law: str) -> dict[str, object]:
    """A contact law of LAMMPS as a variable."""
    return {"normal": law}


def lammps_code(peer: Peer, missing: str) -> Code:
    """LAMMPS with a rolling spring like ours under five weights."""
    told = {"restitution": RESTITUTION_TOLD}
    law = f"{ROUGH.young} {RESTITUTION_TOLD} {ROUGH.poisson}"
    sticky = quoted(f"jkr {law} {sticky_energy()!r}")
    return Code(
        peer.name,
        missing,
        beds=partial(peer_beds, peer=peer, words=told),
        piles=partial(peer_piles, peer=peer, words=told | quoted(f"hertz/material {law}")),
        sticky_piles=partial(peer_piles, peer=peer, words=told | sticky),
    )


def liggghts_code(peer: Peer, missing: str, rolling: str) -> Code:
    """LIGGGHTS with one of its rolling laws; it has no JKR."""
    words = {"rolling": rolling}
    return Code(
        f"{peer.name} {rolling}",
        missing,
        beds=partial(peer_beds, peer=peer, words=words),
        piles=partial(peer_piles, peer=peer, words=words),
        sticky_piles=None,
    )


def contestants() -> list[Code]:
    """All codes, ours first; LIGGGHTS with the rolling law that is ours, and with its stiffer one."""
    ours = Code("ours", "", our_beds, our_piles, partial(our_piles, surface_energy=sticky_energy()))
    lammps, liggghts = PEERS
    absent = {
        peer.name: ""
        if shutil.which(peer.binary)
        else f"{peer.binary} not found (Debian package {peer.package})"
        for peer in PEERS
    }
    return [
        ours,
        lammps_code(lammps, absent[lammps.name]),
        *(liggghts_code(liggghts, absent[liggghts.name], rolling) for rolling in ("epsd", "epsd2")),
    ]
