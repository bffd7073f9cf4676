"""Column collapse of laboratory C: simulates the cases, writes results.csv, draws the figure, fills the page.

python -m doe.lab_c.run             all cases
python -m doe.lab_c.run GROUP...    the cases of some groups
python -m doe.lab_c.run --page      only the figure and the tables of the page, from results.csv
"""

from pathlib import Path

from doe.common.cases import ROOT, Case, perform, settings
from doe.common.command import words
from doe.lab_c.page import publish

SCENE = "scenes/column_collapse.toml"
TABLE = Path(__file__).with_name("results.csv")
LABORATORY = Path(__file__).with_name("laboratory.csv")

LAMMPS_RESTITUTION = 0.616  # at which grains part in the laboratory's code, told 0.5; bounce.lmp [1]
OTHERS = ("grain", "plate", "tube")
BOUNCE = tuple(f"contact.grain-{other}.restitution={LAMMPS_RESTITUTION}" for other in OTHERS)
SEEDS, FEW = 6, 3  # as many repeats as the laboratory made; for the causes
NO_ROLLING_DAMPER = tuple(f"contact.grain-{other}.rolling_damping=0.0" for other in ("grain", "plate"))

CASES = [
    case
    for label, diameter in (("1.5 mm", 1.5e-3), ("3 mm", 3e-3))
    for case in (
        Case("as stated", label, settings(f"grains.size.diameter={diameter}"), SEEDS),
        Case(
            "both causes removed",
            label,
            settings(f"grains.size.diameter={diameter}", *BOUNCE, *NO_ROLLING_DAMPER),
            FEW,
        ),
    )
] + [
    Case("restitution 0.616", "1.5 mm", settings(*BOUNCE), FEW),
    Case("no rolling damper", "1.5 mm", settings(*NO_ROLLING_DAMPER), FEW),
]


def main(asked: list[str]) -> None:
    """Simulate what was asked for, then publish the table."""
    if asked != ["--page"]:
        perform(SCENE, [case for case in CASES if not asked or case.group in asked], TABLE)
    publish(TABLE, LABORATORY, ROOT / "docs")


if __name__ == "__main__":
    main(words(__doc__))
