"""Columns that collapse to heaps, laid alike in every code: a third of the grains of laboratory C.

A column is filled by our code and laid in every code at rest, without memory of its contacts. After a moment
in its tube it is let go and left until the translational kinetic energy of a grain is below 1e-7 m g d, or
until the laboratory's time is up. A rim without friction may stand on the plate.

Rolling has a spring with a slider and no damper. The spring is

    k = 4.5 E* a mu_r^2 R*^2    here, a the contact radius [m]
    k = 8 G* a R*^2             in LIGGGHTS epsd2
    k = 3 E* a mu_r^2 R*^2      in LIGGGHTS epsd, which reads k_n = (4/3) E* a
    k = const R*^2              in LAMMPS sds

The first two are the same where mu_r^2 = 16 G* / (9 E*), and the law is then one in both codes.

Grains of a sticky column adhere to each other by JKR, not to walls; their pull-off force is given in weights.
LAMMPS limits friction and rolling by |F + 6 pi gamma R*| as ours does; LIGGGHTS has no JKR.

Reference: Ai, Chen, Rotter & Ooi (2011), Powder Technology 206, 269; Thornton (1991), J. Phys. D 24, 1942;
Rumpf (1962), in Agglomeration, 379.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import pi, sqrt
from typing import Literal

import numpy as np

from benchmarks.peers.cases import Soil
from benchmarks.peers.codes import ROOT
from benchmarks.peers.physics_cases import Failed, Start, lying, shear_effective, weight, young_effective
from benchmarks.peers.physics_measures import Rest
from taichi_erosion.core.setup import GrainTable, Numerics, Setup
from taichi_erosion.execution.ensemble_loop import EnsembleRun, failure_message, run_ensemble
from taichi_erosion.execution.stages import ReplicaState
from taichi_erosion.scene import Scene, laws, load_scene, replica_setup
from taichi_erosion.simulation import assemble, snapshot

SCENE = ROOT / "scenes" / "column_collapse.toml"
SEEDS = range(1, 13)
TUBE_D = 6.2  # radius of the tube over the diameter: 9 d by the cube root of a third [1]
APPARATUS = ("grains.count=600", f"geometry.tube.radius_d={TUBE_D}", "fill.radius_d=5.6")
UNDAMPED = ("contact.grain-grain.rolling_damping=0.0", "contact.grain-plate.rolling_damping=0.0")
SETTLE, COLLAPSE = 0, 1  # stages of the scene
LOOK = 100  # steps between two looks at the energy
BOX_D = 40.0  # half the side of the open box, over the diameter [1]
NO_RIM_D = BOX_D - 1.0  # radius of a rim that no grain reaches, over the diameter [1]
# weights of a grain under which the spring of LAMMPS is ours: an oblique impact then leaves as much speed as
# with LIGGGHTS epsd2, by the computation of physics_impact [1]
LOAD = 30.0


@dataclass(frozen=True)
class Column:
    """What one case asks for."""

    friction_rolling: float  # of grains on each other and on the plate [1]
    twin: Literal["epsd", "epsd2"]  # rolling law of LIGGGHTS that comes nearest
    rim_d: float = NO_RIM_D  # radius of the rim over the diameter [1]
    restitution: float = 0.5  # of grains and of all walls [1]
    pull: float = 0.0  # pull-off force of two grains over their weight [1]
    changes: tuple[str, ...] = ()  # of the scene

    @property
    def rolls_freely(self) -> bool:
        """Whether no law of rolling acts."""
        return self.friction_rolling == 0.0

    @property
    def sticky(self) -> bool:
        """Whether grains adhere to each other."""
        return self.pull > 0.0


def equal_rolling(poisson: float) -> float:
    """Rolling friction with which our spring is that of epsd2: sqrt(16 G* / (9 E*)), alike materials [1]."""
    return sqrt(8.0 * (1.0 - poisson) / (9.0 * (2.0 - poisson)))


POISSON = 0.25  # of the scene's grains [1]
FREE = Column(0.0, "epsd", rim_d=9.0)  # the rim keeps grains from rolling for ever
ONE_LAW = Column(equal_rolling(POISSON), "epsd2")
BOUNCING = replace(ONE_LAW, restitution=0.9)  # grains hardly damped: all limits of friction are alike
USUAL = Column(0.15, "epsd")
# by Rumpf's strength, 0.8 pulls per d^2 in tension and three times that under weight, a column of five
# diameters just falls if its grains pull each other with two weights
STICKY_FREE, STICKY = replace(FREE, pull=2.0), replace(USUAL, pull=2.0)


@cache
def column_scene(column: Column) -> Scene:
    """The scene of laboratory C, smaller, its rolling undamped."""
    changes = [
        f"contact.grain-{other}.friction_rolling={column.friction_rolling}" for other in ("grain", "plate")
    ]
    changes += [
        f"contact.grain-{other}.restitution={column.restitution}" for other in ("grain", "plate", "tube")
    ]
    rim = {"shape": '"cylinder"', "material": '"tube"', "radius_d": column.rim_d, "length_d": 30.0}
    changes += [f"geometry.rim.{name}={value}" for name, value in rim.items()]
    changes += ["laws.rolling=none"] * column.rolls_freely
    changes += sticking(column) if column.sticky else []
    scene = load_scene(SCENE, (*APPARATUS, *UNDAMPED, *changes, *column.changes))
    return scene.model_copy(update={"measure": {}})


def column_soil(column: Column) -> Soil:
    """The grains of the scene as the decks of the other codes read them; the wall is the plate."""
    scene = column_scene(column)
    grain, rub = scene.materials["grain"], scene.contact["grain-grain"]
    setup = replica_setup(scene, SEEDS[0])
    return Soil(
        diameter=2.0 * float(setup.grains.radius[0]),
        density=grain.density,
        young=grain.young_modulus or 0.0,
        poisson=grain.poisson_ratio,
        restitution=rub.restitution,
        friction=rub.friction_sliding,
        friction_wall=scene.contact["grain-plate"].friction_sliding,
        friction_rolling=column.friction_rolling,
        gravity=scene.gravity.magnitude,
        time_step=setup.time_step,
    )


def surface_energy(column: Column) -> float:
    """Gamma of the pull-off force 3 pi gamma R*, R* = d / 4 [J m-2]."""
    soil = column_soil(replace(column, pull=0.0))
    return column.pull * weight(soil) / (0.75 * pi * soil.diameter)


def sticking(column: Column) -> list[str]:
    """Changes of the scene that let its grains adhere to each other."""
    grains = f"contact.grain-grain.surface_energy={surface_energy(column)!r}"
    return ["laws.normal=jkr", "laws.friction_cap=thornton", grains]


def run_to_end(scene: Scene, setups: Sequence[Setup]) -> list[Rest]:
    """All replicas to the end of the scene, in double precision."""
    sim = assemble(list(setups), laws(scene), Numerics("cpu", 1, "f64"))
    states = [ReplicaState(place) for place, _ in enumerate(setups)]
    run_ensemble(EnsembleRun([scene] * len(setups), sim, states), [])
    for state in states:
        if state.failure:
            raise Failed(f"ours, {failure_message(state.failure, state.seed)}")
    ends = [snapshot(sim, replica) for replica in range(len(setups))]
    return [Rest(state.position, state.velocity, state.spin) for state in ends]


@cache
def laid_columns(column: Column) -> list[Start]:
    """Columns that ours filled, let go at rest."""
    scene = column_scene(column)
    filling = scene.model_copy(update={"stages": scene.stages[:COLLAPSE]})
    return [
        lying(rest.position) for rest in run_to_end(filling, [replica_setup(filling, seed) for seed in SEEDS])
    ]


def our_columns(column: Column, starts: Sequence[Start]) -> list[Rest]:
    """What becomes of some starts in our code."""
    scene = column_scene(column)
    return run_to_end(scene, [placed(replica_setup(scene, SEEDS[0]), start) for start in starts])


def placed(setup: Setup, start: Start) -> Setup:
    """The apparatus with the grains of a start in it."""
    rows = {name: column[: len(start.position)] for name, column in vars(setup.grains).items()}
    rows |= {"position": start.position, "velocity": start.velocity}
    return replace(setup, grains=GrainTable(**rows))


def column_numbers(column: Column) -> dict[str, object]:
    """Variables of the decks: lengths [m], steps, energies [J]."""
    scene, soil = column_scene(column), column_soil(column)
    settle, collapse = scene.stages
    return {
        "tube_radius": TUBE_D * soil.diameter,
        "rim_radius": column.rim_d * soil.diameter,
        "settle": round(settle.duration_min / soil.time_step),
        "look": LOOK,
        "looks": round(collapse.duration_max / (LOOK * soil.time_step)),
        "rest": collapse.rest_energy,
        "scale": scene.grains.count * weight(soil) * soil.diameter,
    }


def lammps_rolling(column: Column) -> dict[str, object]:
    """The rolling laws of LAMMPS between grains and on the plate, and its share of tangential damping."""
    soil = column_soil(column)
    rolling: dict[str, object] = {name: "rolling none" for name in ("rolling_grain", "rolling_plate")}
    if not column.rolls_freely:
        springs = {"rolling_grain": 0.25 * soil.diameter, "rolling_plate": 0.5 * soil.diameter}
        rolling = {
            name: f"rolling sds {rolling_spring(soil, radius)!r} 0.0 {soil.friction_rolling}"
            for name, radius in springs.items()
        }
    # ours is that of LIGGGHTS: c_t / c_n = sqrt(4 G* / E*)
    share = sqrt(4.0 * shear_effective(soil) / young_effective(soil))
    return rolling | {"shear_damping": share}


def rolling_spring(soil: Soil, radius: float, load: float = LOAD) -> float:
    """Our rolling spring over R*^2 [N m-1] under a load [weights], `radius` the effective one [m].

    a^3 = 3 F R* / (4 E*)
    """
    contact_radius = np.cbrt(0.75 * load * weight(soil) * radius / young_effective(soil))
    return float(4.5 * young_effective(soil) * contact_radius * soil.friction_rolling**2)
