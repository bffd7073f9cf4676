"""A small study on the closed-form model, written into a folder: tables of TOML and CSV to change at will."""

from pathlib import Path

import numpy as np

from taichi_erosion.evidence.models.reduced import predict

MODEL = "taichi_erosion.evidence.models.reduced:predict"
MOISTURES, DIAMETERS = (0.0, 0.003, 0.006, 0.01, 0.015, 0.02, 0.03, 0.04), (2e-4, 5e-4)  # kg kg-1, m
SCATTER = {"threshold_u_star": 0.02, "repose_angle": 0.5}  # of one laboratory repeat: relative, deg
UNITS = {"threshold_u_star": "m/s", "repose_angle": "deg"}
TRUTH = {"threshold_coefficient": 0.108, "friction_sliding": 0.53, "friction_rolling": 0.12}
HEADING = "observable,value,n,unit,group,moisture,diameter [mm],source"
LIBRARY = ("liquid_bridge", "dry_cohesion", "saffman_lift", "electrostatics", "side_walls", "gusts")

STUDY = """
[study]
measurements = "heap.csv"
model = "{model}"
[observables.repose_angle]
[observables.threshold_u_star]
transform = "log"
[conditions]
moisture = "moisture"
diameter = "diameter"
[parameters]
threshold_coefficient = {{ start = 0.1, low = 0.05, high = 0.2, prior_sd_log = 0.2 }}
friction_sliding = {{ start = 0.5, low = 0.2, high = 1.0, prior_sd_log = 0.1 }}
friction_rolling = {{ start = 0.1, low = 0.01, high = 0.6 }}
[candidates]
effects = "all"
{candidates}
[vault]
fraction = 0.3
"""


def study_text(library: tuple[str, ...] = LIBRARY, model: str = MODEL) -> str:
    return STUDY.format(model=model, candidates="\n".join(f"[candidates.{name}]" for name in library))


def table_text(effects: dict[str, float], seed: int, repeats: int = 3) -> str:
    """Single repeats of a laboratory in whose world some effects act, over a grid of conditions."""
    random = np.random.default_rng(seed)
    moisture = np.repeat(MOISTURES, len(DIAMETERS))
    diameter = np.tile(DIAMETERS, len(MOISTURES))
    at, lines = {"moisture": moisture, "diameter": diameter}, [HEADING]
    for name, scatter in SCATTER.items():
        exact = np.mean(predict(name, at, TRUTH, effects, np.arange(400)), axis=0)
        spread = scatter * exact if name == "threshold_u_star" else np.full_like(exact, scatter)
        for _ in range(repeats):
            drawn = exact + spread * random.standard_normal(exact.size)
            lines += [
                f"{name},{value:.6g},1,{UNITS[name]},w{w:g} d{d:g},{w:g},{1e3 * d:g},made"
                for value, w, d in zip(drawn, moisture, diameter, strict=True)
            ]
    return "\n".join(lines) + "\n"


def write_study(folder: Path, effects: dict[str, float], seed: int = 1, study: str | None = None) -> Path:
    """Study and table in a folder; returns the study file."""
    (folder / "heap.csv").write_text(table_text(effects, seed), encoding="utf-8")
    path = folder / "heap.toml"
    path.write_text(study_text() if study is None else study, encoding="utf-8")
    return path
