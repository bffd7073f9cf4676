"""Sealed cases of a perturbed laboratory: our simulator with other laws than the study's, and hidden effects.

    python -m doe.t2.run seal SECRET      draw the truths into the folder SECRET, write their digest
    python -m doe.t2.run make SECRET      simulate the laboratories' tables
    python -m doe.t2.run solve            discover and adopt, by the commands, without the truths
    python -m doe.t2.run score SECRET     open the truths and write results.csv

The study is that of ../t1: Hertz, and a rolling spring with a slider (elastic_plastic). Its laboratories have
JKR, EDEM's limit of friction, a constant rolling torque, stiffer grains, a finer time step, a looser filling.
Three cases hide nothing, five one effect, two a pair, two something that no candidate describes.
"""

import random
from functools import partial
from math import pi
from pathlib import Path

from doe.sealed.heaps import DIAMETERS, MOST, OUTSIDE, Heaps, drawn_numbers, measure
from doe.sealed.studies import Case, SealedSet, steps

HERE = Path(__file__).parent
CAMPAIGN = HERE.parents[1] / "campaigns" / "t2"
SCENE = HERE.with_name("t1") / "column.toml"
HIDDEN = (  # effects, and what no candidate describes
    *[((), None)] * 3,
    (("liquid_bridge",), None),
    (("dry_adhesion",), None),
    (("rolling_resistance",), None),
    (("size_distribution",), None),
    (("image_charge",), None),
    (("liquid_bridge", "rolling_resistance"), None),
    (("dry_adhesion", "size_distribution"), None),
    *[((), outside) for outside in OUTSIDE],
)
WEAKEST, STRONGEST = 0.5, 2.0  # of a hidden effect, log-uniform
LAWS = ("laws.normal=jkr", "laws.friction_cap=edem", "laws.rolling=constant_torque")
PULLS = (0.01, 0.05)  # of JKR at the smaller diameter over the weight, log-uniform: far below one weight [1]
STIFFER = (1.5, 3.0)  # Young's modulus over that of the scene, log-uniform [1]
PITCHES = (1.2, 1.4)  # of the filling, over the diameter [1]
MODULUS, STEP_D = 5e5, 3e-2  # of the scene [Pa, s m-1]
FINER = 0.8  # time step over the one that the stiffness asks for [1]
DENSITY, GRAVITY = 2500.0, 9.81  # kg m-3, m s-2


def draw(generator: random.Random) -> list[Case]:
    """The truth of every case, in an order that tells nothing."""
    hidden = list(HIDDEN)
    generator.shuffle(hidden)
    cases = []
    for number, (names, outside) in enumerate(hidden):
        effects = {n: min(between(generator, WEAKEST, STRONGEST), MOST.get(n, STRONGEST)) for n in names}
        laboratory = {
            "surface_energy": surface_energy(between(generator, *PULLS), DIAMETERS[0]),
            "young_modulus": MODULUS * between(generator, *STIFFER),
            "pitch_d": generator.uniform(*PITCHES),
        }
        numbers = drawn_numbers(generator)
        told = {"number": number, "effects": effects, "outside": outside}
        cases.append({**told, "numbers": numbers, "laboratory": laboratory})
    return cases


def between(generator: random.Random, low: float, high: float) -> float:
    """A number that is log-uniform between two."""
    return low * (high / low) ** generator.random()


def surface_energy(pull: float, diameter: float) -> float:
    """Surface energy [J m-2] whose pull-off force is `pull` times the weight of a grain.

    F = 3 pi gamma R*, with R* = d / 4 of two equal grains; docs/contact_laws.md.
    """
    weight = DENSITY * pi / 6.0 * diameter**3 * GRAVITY
    return pull * weight / (3.0 * pi * diameter / 4.0)


def settings(case: Case) -> tuple[str, ...]:
    """How the runs of a laboratory differ from the scene, effects and friction apart.

    The time step is that of the scene over the root of the stiffness, and finer.
    """
    laboratory = case["laboratory"]
    modulus = laboratory["young_modulus"]
    step = FINER * STEP_D * (MODULUS / modulus) ** 0.5
    return (
        *LAWS,
        f"contact.grain-grain.surface_energy={laboratory['surface_energy']!r}",
        *(f"materials.{name}.young_modulus={modulus!r}" for name in ("grain", "plate", "tube")),
        f"fill.pitch_d={laboratory['pitch_d']!r}",
        f"run.time_step_d={step!r}",
    )


HEAPS = Heaps(CAMPAIGN, SCENE, settings)
SET = SealedSet(CAMPAIGN, HERE, draw, partial(measure, HEAPS))

if __name__ == "__main__":
    steps(SET)()
