"""Ten million steps of a bed at rest: does anything drift?

python -m doe.long_run.run f32 [MINUTES]     go on in single precision, for so many minutes at most
python -m doe.long_run.run f64 [MINUTES]     the same in double precision
python -m doe.long_run.run --page            only the table of the page, from the tables

A part of the run ends with a checkpoint; the next call goes on from it, bit for bit. One thread.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from doe.common.command import words
from doe.common.tables import read_table, write_table
from taichi_erosion.core.errors import SimulationStopped
from taichi_erosion.core.files import write_atomic
from taichi_erosion.core.setup import Numerics
from taichi_erosion.recording.checkpoint import load_checkpoint, save_checkpoint
from taichi_erosion.report.markdown import fill_table, markdown_table
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.sanity_checks import failure_message
from taichi_erosion.scene import laws, scene_hash
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    export_state,
    failure,
    import_state,
    prepare,
    snapshot,
    totals,
)

Floats = NDArray[np.float64]

FOLDER = Path(__file__).parent
SCENE = FOLDER / "bed.toml"
PAGE = FOLDER.parents[1] / "docs" / "trust.md"
SETTLE = 300_000  # steps that bring the bed to rest and are not counted
STEPS = 10_000_000
ROW = 100_000  # steps from one row of the table to the next
SAVE = 600.0  # s of wall time between checkpoints
START = "start_position"  # entry of a checkpoint: where the grains lay when counting began
MEGABYTE = 2**20
SHOWN = (0, 1_000_000, 3_000_000, 10_000_000)  # steps in the table of the page

Precision = Literal["f32", "f64"]


@dataclass(frozen=True)
class Row:
    """The bed after some steps; a column's unit is part of its name."""

    steps: int  # counted
    time_s: float
    centroid_m: float  # mean height
    way_largest_m: float  # of any grain, from its place when counting began
    kinetic_translation_j: float
    kinetic_rotation_j: float
    potential_j: float
    elastic_j: float
    momentum_kg_m_per_s: float
    contacts: int
    overlap_largest: float  # over the smaller radius
    rebuilds: int  # of the contact lists
    memory_mb: float  # resident
    wall_s: float  # since the row before


def main(precision: Precision, minutes: float) -> None:
    """Go on until the steps are done or the minutes are over."""
    end = time.monotonic() + 60.0 * minutes
    scene = read_scene(SCENE, ())
    setup = prepare(scene, scene.run.seed, {})
    sim = assemble([setup], laws(scene), Numerics("cpu", 1, precision))
    kept, table = FOLDER / "recordings" / f"bed-{precision}.npz", FOLDER / f"{precision}.csv"
    if kept.exists():
        state, _ = load_checkpoint(kept, scene_hash(scene))
        import_state(sim, state)
        start, rows = state[START], read_table(table, Row)
    else:
        go_on(sim, SETTLE)
        start = snapshot(sim, 0).position
        rows = [look(sim, start, 0.0)]
    saved = time.monotonic()
    while rows[-1].steps < STEPS and time.monotonic() < end:
        began = time.monotonic()
        go_on(sim, SETTLE + rows[-1].steps + ROW)
        rows.append(look(sim, start, time.monotonic() - began))
        if time.monotonic() > min(saved + SAVE, end) or rows[-1].steps == STEPS:
            saved = time.monotonic()
            save_checkpoint(kept, export_state(sim) | {START: start}, {"scene_hash": scene_hash(scene)})
            write_table(table, Row, rows, digits=10)
            sys.stderr.write(f"{precision}: {rows[-1].steps} steps\n")


def go_on(sim: Simulation, steps: int) -> None:
    """Advance to a number of steps. Raises SimulationStopped where a guard ends the run."""
    advance(sim, [steps * sim.setups[0].time_step])
    stopped = failure(sim, 0)
    if stopped is not None:
        raise SimulationStopped(failure_message(stopped, 1))


def look(sim: Simulation, start: Floats, seconds: float) -> Row:
    """One row of the table."""
    state, sums = snapshot(sim, 0), totals(sim, 0)
    return Row(
        steps=state.step - SETTLE,
        time_s=state.time,
        centroid_m=float(np.average(state.position[:, 2], weights=state.mass)),
        way_largest_m=float(np.linalg.norm(state.position - start, axis=1).max()),
        kinetic_translation_j=sums.kinetic_translation,
        kinetic_rotation_j=sums.kinetic_rotation,
        potential_j=sums.potential,
        elastic_j=sums.elastic,
        momentum_kg_m_per_s=float(np.linalg.norm(state.mass @ state.velocity)),
        contacts=sums.contacts,
        overlap_largest=sums.overlap_largest,
        rebuilds=sums.rebuilds,
        memory_mb=resident_memory() / MEGABYTE,
        wall_s=seconds,
    )


def resident_memory() -> int:
    """Memory of this process that lies in RAM [bytes]."""
    import psutil

    return psutil.Process().memory_info().rss


def publish() -> None:
    """Fill the table of the page."""
    header = (
        "precision",
        "steps",
        "kinetic energy of translation, nJ",
        "of rotation, nJ",
        "potential energy, its change over itself",
        "stored energy, its change over itself",
        "momentum, nN s",
        "largest way of a grain, diameters",
        "contacts",
        "memory, MB",
    )
    cells = [line for p in ("f32", "f64") if (FOLDER / f"{p}.csv").exists() for line in page_rows(p)]
    page = fill_table(PAGE.read_text(encoding="utf-8"), "long run", markdown_table(header, cells))
    write_atomic(PAGE, page.encode())


def page_rows(precision: str) -> list[tuple[str, ...]]:
    """Rows of one precision on the page."""
    rows = read_table(FOLDER / f"{precision}.csv", Row)
    diameter = read_scene(SCENE, ()).grains.size.median  # pyright: ignore[reportAttributeAccessIssue]
    first = rows[0]
    return [
        (
            precision,
            f"{row.steps:,}",
            f"{1e9 * row.kinetic_translation_j:.2g}",
            f"{1e9 * row.kinetic_rotation_j:.3g}",
            f"{row.potential_j / first.potential_j - 1.0:.1e}",
            f"{row.elastic_j / first.elastic_j - 1.0:.1e}",
            f"{1e9 * row.momentum_kg_m_per_s:.2g}",
            f"{row.way_largest_m / diameter:.1e}",
            str(row.contacts),
            f"{row.memory_mb:.0f}",
        )
        for row in rows
        if row.steps in SHOWN or row is rows[-1]
    ]


if __name__ == "__main__":
    asked = words(__doc__)
    if asked == ["--page"]:
        publish()
    elif asked and asked[0] in ("f32", "f64"):
        main(asked[0], float(asked[1]) if len(asked) > 1 else 1e9)  # pyright: ignore[reportArgumentType]
    else:
        sys.exit(__doc__)
