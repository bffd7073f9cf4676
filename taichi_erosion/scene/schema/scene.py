"""A scene file as typed, frozen records: the only place where defaults stand."""

from pathlib import Path
from typing import Literal

from pydantic import Field, PrivateAttr, model_validator

from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.scene.schema.fields import (
    FASTEST,
    Name,
    PairName,
    Part,
    Vector,
    check_direction,
    contradiction,
    direction,
    number,
    position,
)
from taichi_erosion.scene.schema.geometry import ORIGIN, Wall
from taichi_erosion.scene.schema.grains import Contact, Fill, Grains, Material
from taichi_erosion.scene.schema.wind import FASTEST_FRICTION, Threshold, Wind

SHORTEST = 1e-12  # shortest time that a scene may name [s]
LONGEST = 1e5  # longest [s]
MOST_REPLICAS = 100_000


class Head(Part):
    """What the scene is."""

    kind: Literal[
        "repose",
        "collapse",
        "lifting",
        "drum",
        "incline",
        "settling",
        "packed_bed",
        "threshold",
        "saltation",
    ] = Field(description="kind of apparatus")
    title: str = Field(default="", max_length=200, description="one line for people")
    notes: str = Field(default="", max_length=20_000, description="assumptions and sources")


class Conditions(Part):
    """What a laboratory writes beside a measurement; effects read them."""

    moisture: float | None = number(None, "kg kg-1", "mass of water over mass of solid", 0.0, 1.0)
    temperature: float | None = number(None, "K", "air temperature", 200.0, 400.0)
    relative_humidity: float | None = number(None, "1", "relative humidity of the air", 0.0, 1.0)
    pressure: float | None = number(None, "Pa", "air pressure", 1e2, 2e5)
    altitude: float | None = number(None, "m", "height above sea level", -500.0, 9000.0)
    slope: float | None = number(None, "deg", "slope of the bed, uphill positive", -90.0, 90.0)
    wind_speed: float | None = number(None, "m s-1", "free-stream wind speed", 0.0, 100.0)
    friction_velocity: float | None = number(None, "m s-1", "friction velocity u*", 0.0, 10.0)
    diameter: float | None = number(None, "m", "grain diameter as the laboratory states it", 1e-6, 1.0)
    angularity: float | None = number(None, "1", "shape index: 0 round, 1 most angular", 0.0, 1.0)
    clay_fraction: float | None = number(None, "kg kg-1", "mass fraction of clay", 0.0, 1.0)
    organic_fraction: float | None = number(None, "kg kg-1", "mass fraction of organic matter", 0.0, 1.0)
    salinity: float | None = number(None, "kg kg-1", "mass fraction of salts", 0.0, 1.0)
    roughness_density: float | None = number(
        None, "1", "frontal area of stones or plants over ground area", 0.0, 10.0
    )
    fetch: float | None = number(None, "m", "length of loose bed upwind of the trap", 0.0, 1e6)
    rest_duration: float | None = number(None, "s", "time at rest before the test", 0.0, 1e9)


class Run(Part):
    """How the scene is repeated and stepped."""

    replicas: int = number(1, "1", "independent repeats", 1, MOST_REPLICAS)
    seed: int = number(1, "1", "seed of the first replica; the next take the next integers", 0, 2**62)
    precision: Literal["f32", "f64"] = Field(
        default="f32", description="floating-point type of forces and velocities"
    )
    time_step: float | None = number(None, "s", "time step; left out: time_step_fraction", SHORTEST, 1.0)
    time_step_fraction: float = number(0.2, "1", "time step over the Rayleigh time", 1e-4, 10.0)
    force_time_step: bool = Field(default=False, description="accept more than 0.3 Rayleigh times")
    check_interval: float = number(1e-3, "s", "simulated time between guards and rest checks", 1e-9, 10.0)
    skin: float = number(
        Setup.skin, "1", "least margin of the neighbour list over the grain radius", 1e-3, 1.0
    )
    overlap_limit: float = number(
        Setup.overlap_limit, "1", "overlap over the smaller radius that stops the run", 1e-4, 1.0
    )


class Gravity(Part):
    """Weight."""

    magnitude: float = number(9.81, "m s-2", "acceleration of gravity", 0.0, 1e4)
    direction: Vector = direction((0.0, 0.0, -1.0), "direction of gravity at the start")

    @model_validator(mode="after")
    def _has_direction(self) -> "Gravity":
        check_direction(self.direction, "direction")
        return self


class LawChoice(Part):
    """Law in every contact slot; the defaults are those of core.setup.Laws."""

    normal: Literal["hertz", "jkr"] = Field(default=Laws.normal, description="normal force")
    adhesion_branch: Literal["touch", "edem"] = Field(
        default=Laws.adhesion_branch,
        description="touch: adhesion acts after contact only; edem: on approach too",
    )
    friction_cap: Literal["thornton", "edem"] = Field(
        default=Laws.friction_cap, description="normal force in the Coulomb cap under adhesion"
    )
    rolling: Literal["none", "constant_torque", "elastic_plastic"] = Field(
        default=Laws.rolling, description="rolling resistance: none, type A, type C (Ai et al. 2011)"
    )


class Movement(Part):
    """Rigid motion of a surface during a stage."""

    velocity: Vector = number(ORIGIN, "m s-1", "velocity", -FASTEST, FASTEST)
    spin: Vector = number(ORIGIN, "rad s-1", "angular velocity", -1e4, 1e4)
    centre: Vector = position(ORIGIN, "a point of the spin axis")


class Stage(Part):
    """One act of the experiment; changes happen at its beginning."""

    name: Name = Field(description="name by which measures refer to it")
    until: Literal["rest", "time", "threshold"] = Field(
        "rest",
        description="rest: when grains rest; time: after duration_max; threshold: when thresholds are found",
    )
    duration_min: float = number(0.0, "s", "shortest duration", 0.0, LONGEST)
    duration_max: float = number(..., "s", "time limit, or the duration itself", SHORTEST, LONGEST)
    rest_energy: float = number(
        1e-5, "1", "translational kinetic energy per grain over m g d at rest", 0.0, 1.0
    )
    rest_contact_share: float = number(0.9, "1", "least share of grains with a contact at rest", 0.0, 1.0)
    remove: tuple[Name, ...] = Field((), description="surfaces that vanish when the stage begins")
    move: dict[Name, Movement] = Field({}, description="motion of surfaces by name, until the next order")
    tilt_rate: float = number(0.0, "deg s-1", "rate at which gravity turns about tilt_axis", -1e4, 1e4)
    tilt_axis: Vector = direction((0.0, 1.0, 0.0), "axis about which the apparatus is tilted")
    friction_velocity: float | None = number(
        None,
        "m s-1",
        "u* from the beginning of the stage on, its profile at once steady",
        0.0,
        FASTEST_FRICTION,
    )
    through_flow: float | None = number(
        None, "m s-1", "superficial velocity of air rising through the bed from now on", -100.0, 100.0
    )

    @model_validator(mode="after")
    def _in_order(self) -> "Stage":
        check_direction(self.tilt_axis, "tilt_axis")
        if self.duration_min > self.duration_max:
            raise contradiction("duration_min exceeds duration_max")
        return self


class Measure(Part):
    """When and how one observable is read; what is left out is the measure's own choice."""

    stage: Name | None = Field(None, description="stage at whose end it is read; left out: the last")
    azimuths: int | None = number(None, "1", "number of silhouettes over half a turn", 1, 360)
    every: float | None = number(None, "s", "interval of repeated reading within the stage", 1e-6, LONGEST)
    plate: Name | None = Field(None, description="surface on which the heap stands")


class Measured(Part):
    """A laboratory's value, printed beside the simulated one."""

    value: float = number(..., "unit of the observable", "mean of the repeats")
    sd: float | None = number(None, "unit of the observable", "standard deviation of single repeats", 0.0)
    n: int | None = number(None, "1", "number of repeats", 1, 10**9)
    source: str = Field(default="", max_length=500, description="where it was published")


class Record(Part):
    """What the recording keeps."""

    every: float = number(0.01, "s", "interval of frames of moving grains", 1e-9, LONGEST)
    bed_every: float = number(0.1, "s", "interval of frames of the whole bed", 1e-9, LONGEST)


class Scene(Part):
    """One physical situation."""

    scene: Head
    conditions: Conditions = Conditions()
    run: Run = Run()
    gravity: Gravity = Gravity()
    grains: Grains
    materials: dict[Name, Material] = Field(min_length=1)
    laws: LawChoice = LawChoice()
    contact: dict[PairName, Contact] = Field(min_length=1)
    geometry: dict[Name, Wall] = Field({})
    fill: Fill
    wind: Wind | None = Field(None, description="air over a periodic patch; left out: no air")
    threshold: Threshold = Field(Threshold(), description="how thresholds of motion are looked for")
    stages: tuple[Stage, ...] = Field(min_length=1, max_length=1000)
    measure: dict[Name, Measure] = Field({})
    measured: dict[Name, Measured] = Field({})
    record: Record = Record()
    effects: dict[Name, dict[Name, float]] = Field({}, description="optional physics: parameters by effect")

    _folder: Path = PrivateAttr(default=Path())
    _file: str = PrivateAttr(default="scene")

    @property
    def folder(self) -> Path:
        """Folder of the scene file, where meshes are looked for."""
        return self._folder

    @property
    def file(self) -> str:
        """Name of the scene file as the user wrote it, for messages."""
        return self._file
