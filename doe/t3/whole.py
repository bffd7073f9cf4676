"""Seven laboratories in the whole apparatus of laboratory C, made by LAMMPS, asked by ../foreign_lab_c.toml.

    python -m doe.t3.whole make        113 heaps of 1800 grains, half a minute of a core each
    python -m doe.t3.whole solve       discover and adopt, by the commands; several core-hours
    python -m doe.t3.whole score        results_whole.csv

They were chosen, not drawn: water whose pull grows in proportion to its amount, which our law does not know;
nothing at all; water and rolling resistance together; a pull of dry grains; and three that no candidate
describes: sliding friction that grows with angularity, rolling friction that grows with water, and sliding
friction that water lowers.
"""

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from doe.common.command import run_step
from doe.sealed.studies import command
from doe.t3.run import DENSITY, GRAVITY, WHOLE, Grains, laboratory_run
from taichi_erosion.core.files import write_atomic

HERE = Path(__file__).parent
FOLDER = HERE.parents[1] / "campaigns" / "t3_whole"
STUDY = HERE.with_name("foreign_lab_c.toml")
SCENE = HERE.with_name("foreign_lab") / "column.toml"
TABLE = HERE / "results_whole.csv"
DIAMETERS = (1.5e-3, 3e-3)  # m
BARE = Grains(sliding=0.54, rolling=0.12)
WEIGHT_D = DENSITY * pi / 6.0 * DIAMETERS[0] ** 2 * GRAVITY  # of the smaller grains, over d [N m-1]
REPEATS, REPEATS_BARE = 3, 6
HEAD = "observable,value,sd,n,unit,group,moisture,diameter,angularity,source"


@dataclass(frozen=True)
class Laboratory:
    """Conditions (moisture, angularity), and the grains at each."""

    conditions: tuple[tuple[float, float], ...]
    grains: Callable[[float, float], Grains]


LABORATORIES = {
    "wet_linear": Laboratory(
        ((0.0, 0.0), (0.01, 0.0), (0.02, 0.0), (0.04, 0.0)),
        lambda w, a: Grains(BARE.sliding, BARE.rolling, WEIGHT_D * w / 0.02),
    ),
    "null": Laboratory(((0.0, 0.0), (0.02, 0.0), (0.0, 1.0)), lambda w, a: BARE),
    "pair": Laboratory(
        ((0.0, 0.0), (0.02, 0.0), (0.0, 1.0), (0.02, 1.0)),
        lambda w, a: Grains(BARE.sliding, BARE.rolling + 0.25 * a, 0.8 * WEIGHT_D * (w > 0.0)),
    ),
    "friction_angular": Laboratory(
        ((0.0, 0.0), (0.0, 0.5), (0.0, 1.0)),
        lambda w, a: Grains(BARE.sliding * (1.0 + 0.5 * a), BARE.rolling),
    ),
    "dry_pull": Laboratory(
        ((0.0, 0.0), (0.0, 0.5), (0.0, 1.0)), lambda w, a: Grains(BARE.sliding, BARE.rolling, WEIGHT_D)
    ),
    "rolling_wet": Laboratory(
        ((0.0, 0.0), (0.01, 0.0), (0.02, 0.0)), lambda w, a: Grains(BARE.sliding, BARE.rolling + 15.0 * w)
    ),
    "slippery": Laboratory(
        ((0.0, 0.0), (0.01, 0.0), (0.02, 0.0)),
        lambda w, a: Grains(BARE.sliding * (1.0 - 30.0 * w), BARE.rolling),
    ),
}


def heap_of(grains: Grains, diameter: float, key: str) -> dict[str, tuple[float, str]]:
    """Values and units of one heap, made once."""
    kept = FOLDER / "heaps" / f"{key}.json"
    if kept.exists():
        return json.loads(kept.read_text("utf-8"))
    seed = int.from_bytes(sha256(key.encode()).digest()[:4], "big")
    found = laboratory_run(WHOLE, grains, diameter, np.random.default_rng(seed))
    values = {name: (one.value, one.unit) for name, one in found.items()}
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(kept, json.dumps(values).encode())
    return json.loads(json.dumps(values))


def rows(name: str, laboratory: Laboratory) -> list[str]:
    """Table of one laboratory: means of its repeats."""
    lines = [HEAD]
    for d in DIAMETERS:
        for w, a in laboratory.conditions:
            grains = laboratory.grains(w, a)
            who = "base" if grains == BARE else name
            count = REPEATS_BARE if (w, a) == (0.0, 0.0) else REPEATS
            heaps = [heap_of(grains, d, f"{who}_{d:g}_{w:g}_{a:g}_{k}") for k in range(count)]
            for observable, (_, unit) in heaps[0].items():
                values = [heap[observable][0] for heap in heaps]
                mean, sd = np.mean(values), np.std(values, ddof=1)
                group = "fill" if observable == "column_height" else "collapse"
                at = f"{unit},{group},{w:g},{d:g},{a:g}"
                lines.append(f"{observable},{mean:.6g},{sd:.6g},{count},{at},LAMMPS")
    return lines


def make() -> None:
    """Tables and studies."""
    (FOLDER / "foreign_lab").mkdir(parents=True, exist_ok=True)
    (FOLDER / "foreign_lab" / "column.toml").write_text(SCENE.read_text("utf-8"), encoding="utf-8")
    for name, laboratory in LABORATORIES.items():
        (FOLDER / f"{name}.csv").write_text("\n".join(rows(name, laboratory)) + "\n", encoding="utf-8")
        text = STUDY.read_text("utf-8").replace('"measured/lab_c.csv"', f'"{name}.csv"\nruns = "runs"')
        (FOLDER / f"{name}.toml").write_text(text, encoding="utf-8")


def solve() -> None:
    """What the commands say; what has been solved is not solved again."""
    for name in LABORATORIES:
        answer = FOLDER / f"{name}.solved.json"
        if not answer.exists():
            study = FOLDER / f"{name}.toml"
            found = command("discover", study, "--budget", "quick")
            names = found["named"] or found["group"]
            adopted = command("adopt", study, names[0]) if names else {"vault": None}
            write_atomic(answer, json.dumps({"found": found, "vault": adopted["vault"]}).encode())


def score_row(name: str) -> dict[str, Any]:
    """One row of the table."""
    answer = json.loads((FOLDER / f"{name}.solved.json").read_text("utf-8"))
    found, vault = answer["found"], answer["vault"] or {}
    return {
        "laboratory": name,
        "verdict": found["verdict"],
        "named": " ".join(found["named"]),
        "group": " ".join(found["group"]),
        "probability": f"{max(found['probabilities'].values()):.3f}",
        "chi2_before": f"{found['chi2_before']:.4g}",
        "chi2_after": f"{found['chi2_after']:.4g}",
        "rows": found["n"],
        "vault_before": f"{vault['chi2_per_row_before']:.3g}" if vault else "",
        "vault_after": f"{vault['chi2_per_row_after']:.3g}" if vault else "",
        "vault_wrong": f"{vault['chi2_per_row_wrong_effect']:.3g}" if vault else "",
        "runs": found["runs"],
        "wall_s": f"{found['wall_s']:.0f}",
    }


def score() -> None:
    """The table of those that are solved."""
    done = [score_row(name) for name in LABORATORIES if (FOLDER / f"{name}.solved.json").exists()]
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(done[0]))
        writer.writeheader()
        writer.writerows(done)


if __name__ == "__main__":
    run_step(__doc__, {"make": make, "solve": solve, "score": score})
