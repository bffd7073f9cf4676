"""Sealed cases on the simulator: heaps made with hidden effects, which the commands then have to find.

    python -m doe.t1.run seal SECRET      draw the truths into the folder SECRET, write their digest
    python -m doe.t1.run make SECRET      simulate the laboratories' tables
    python -m doe.t1.run solve            discover and adopt, by the commands, without the truths
    python -m doe.t1.run score SECRET     open the truths and write results.csv

Six cases hide nothing, twelve one effect, four two, two something that no candidate describes. A laboratory
has its own seeds, time step, packing and friction. All cases share one campaign: surfaces are simulated once.
"""

import random
from functools import partial
from pathlib import Path

from doe.sealed.heaps import CANDIDATES, MOST, OUTSIDE, Heaps, drawn_numbers, measure
from doe.sealed.studies import Case, SealedSet, steps

HERE = Path(__file__).parent
CAMPAIGN = HERE.parents[1] / "campaigns" / "t1"
AGAIN = ("liquid_bridge", "dry_adhesion", "rolling_resistance", "size_distribution")  # at another strength
PAIRS = (
    ("liquid_bridge", "rolling_resistance"),
    ("dry_adhesion", "rolling_resistance"),
    ("liquid_bridge", "size_distribution"),
    ("rolling_resistance", "size_distribution"),
)
STRENGTHS = (0.3, 1.0, 2.0)  # over the textbook, times up to 1.3 either way
PACKING = ("run.time_step_d=2.4e-2", "fill.pitch_d=1.2")


def draw(generator: random.Random) -> list[Case]:
    """The truth of every case, in an order that tells nothing."""
    hidden = [((), None)] * 6 + [((name,), None) for name in (*CANDIDATES, *AGAIN)]
    hidden += [(pair, None) for pair in PAIRS] + [((), outside) for outside in OUTSIDE]
    generator.shuffle(hidden)
    cases = []
    for number, (names, outside) in enumerate(hidden):
        effects = {name: drawn_strength(generator, name, len(names)) for name in names}
        numbers = drawn_numbers(generator)
        cases.append({"number": number, "effects": effects, "outside": outside, "numbers": numbers})
    return cases


def drawn_strength(generator: random.Random, name: str, together: int) -> float:
    """A strength near one of three levels; effects of a pair are not weak."""
    level = generator.choice(STRENGTHS[1:] if together > 1 else STRENGTHS)
    return min(level * generator.uniform(0.77, 1.3), MOST.get(name, 3.0))


HEAPS = Heaps(CAMPAIGN, HERE / "column.toml", lambda _: PACKING)
SET = SealedSet(CAMPAIGN, HERE, draw, partial(measure, HEAPS))

if __name__ == "__main__":
    steps(SET)()
