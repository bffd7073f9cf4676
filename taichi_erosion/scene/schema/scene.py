"""A scene file as typed, frozen records: the only place where defaults stand."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from math import isfinite
from typing import Literal

from pydantic import Field

from taichi_erosion.core import setup
from taichi_erosion.core.errors import did_you_mean
from taichi_erosion.scene.schema import fields
from taichi_erosion.scene.schema.conditions import Conditions
from taichi_erosion.scene.schema.fields import Direction, Name, Vector, direction, entry, number, point_field
from taichi_erosion.scene.schema.geometry import ORIGIN, Domain, Wall
from taichi_erosion.scene.schema.grains import Contact, Fill, Grains, Material, contact_of_two_kinds
from taichi_erosion.scene.schema.wind import COLUMNS_LEAST, FASTEST_FRICTION, Threshold, Wind

FROM_THRESHOLDS = (
    *("rolling_onset", "fluid_threshold", "threshold_u_star", "threshold_wind_speed"),
    *("impact_threshold", "impact_threshold_linear", "threshold_ratio", "threshold_ratio_linear"),
)
SPLASH = ("rebound_share", "rebound_speed", "ejecta_share")
UNDER_WIND = (*("pressure_drop", "flux", "flux_height", "bed_stress", "grain_stress"), *SPLASH)  # means
OF_STRESS = ("shear_stress", "normal_stress")  # of a plane that is sheared
OF_SHEAR = ("friction_angle", "residual_friction_angle", "peak_displacement", *OF_STRESS)
OF_WALLS = ("wall_force", "wall_torque", *OF_SHEAR)  # read from the forces of the grains on walls
BY_KIND = ("pile_height", "centroid_height", "radius_90", "runout_radius", "column_height", "bed_height")
BY_KIND += ("mass_flow", "flux", "flux_height", "settling_velocity", *SPLASH)  # read from grains alone
OF_ONE_COLUMN = ("bed_stress", "pressure_drop")  # measures that read its mixing length or its rising air
SHORTEST = 1e-12  # shortest time that a scene may name [s]
LONGEST = 1e5  # longest [s]
MOST_REPLICAS = 100_000

MotionRow = tuple[float, float, float, float, float, float, float]
Kind = Literal[
    "repose", "collapse", "lifting", "drum", "incline", "settling", "packed_bed", "threshold", "saltation"
]


class Head(fields.Section):
    """What the scene is."""

    kind: Kind | None = entry(None, "kind of apparatus; left out: one of your own")
    title: str = Field(default="", max_length=200, description="one line for people")
    notes: str = Field(default="", max_length=20_000, description="assumptions and sources")
    effect_files: tuple[str, ...] = entry(
        (), "Python files with effects of your own, relative to the scene file"
    )


class Run(fields.Section):
    """How the scene is repeated and stepped."""

    replicas: int = number(1, "1", "independent repeats", 1, MOST_REPLICAS)
    seed: int = number(1, "1", "seed of the first replica; the next take the next integers", 0, 2**62)
    precision: setup.Precision = entry("f32", "floats of forces and velocities")
    time_step: float | None = number(None, "s", "time step; left out: time_step_fraction", SHORTEST, 1.0)
    time_step_fraction: float = number(0.2, "1", "time step over the Rayleigh time", 1e-4, 10.0)
    force_time_step: bool = entry(False, "accept more than 0.3 Rayleigh times")
    check_interval: float = number(1e-3, "s", "simulated time between guards and rest checks", 1e-9, 10.0)
    skin: float = number(setup.Setup.skin, "1", "least margin of neighbour list over radius", 1e-3, 1.0)
    overlap_limit: float = number(
        setup.Setup.overlap_limit, "1", "overlap over the smaller radius that stops the run", 1e-4, 1.0
    )


class Gravity(fields.Section):
    """Weight."""

    magnitude: float = number(9.81, "m s-2", "acceleration of gravity", 0.0, 1e4)
    direction: Direction = direction((0.0, 0.0, -1.0), "direction of gravity at the start")

    @property
    def vector(self) -> Vector:
        """Acceleration at the start [m s-2]."""
        x, y, z = fields.unit_vector(self.direction)
        return self.magnitude * x, self.magnitude * y, self.magnitude * z


class LawChoice(fields.Section):
    """Law in every contact slot; the defaults are those of core.setup.Laws."""

    normal: setup.NormalLaw = entry(setup.Laws.normal, "normal force")
    adhesion_branch: setup.AdhesionBranch = entry(
        setup.Laws.adhesion_branch,
        "where adhesion acts: touch, from zero overlap until the neck tears, as in LAMMPS; "
        "edem, on approach too, wherever a neck can exist, as in EDEM",
    )
    friction_cap: setup.FrictionCap = entry(
        setup.Laws.friction_cap,
        "normal force that limits friction under adhesion: thornton, |F + 6 pi gamma R*|, as in LAMMPS; "
        "edem, the repulsive part 4 E* a^3 / (3 R*)",
    )
    rolling: setup.RollingLaw = entry(
        setup.Laws.rolling, "rolling resistance: none, type A, type C (Ai et al. 2011)"
    )


class Movement(fields.Section):
    """Rigid motion of a surface during a stage."""

    later = ("table", "axis", "fastest")
    velocity: Vector = number(ORIGIN, "m s-1", "velocity", -fields.FASTEST, fields.FASTEST)
    spin: Vector = number(ORIGIN, "rad s-1", "angular velocity", -1e4, 1e4)
    centre: Vector = point_field(ORIGIN, "a point of the spin axis, also of a torque")
    table: tuple[MotionRow, ...] = number(
        (),
        "s, m s-1, rad s-1",
        "rows of time since the order, velocity along x, y, z and spin about x, y, z, joined by straight "
        "lines; after the last row its motion goes on",
        -LONGEST,
        LONGEST,
    )
    force: float | None = number(
        None, "N", "force along `axis` with which the wall pushes the grains, kept by a servo", -1e6, 1e6
    )
    torque: float | None = number(None, "N m", "torque about `axis`, likewise", -1e6, 1e6)
    axis: Direction = direction((0.0, 0.0, 1.0), "axis of force or torque")
    fastest: float = number(0.1, "m s-1 or rad s-1", "largest speed of the servo", 1e-9, fields.FASTEST)

    def contradictions(self) -> Iterator[str]:
        if self.force is not None and self.torque is not None:
            yield "force and torque: a servo keeps one of them"
        if self.table and (any(self.velocity) or any(self.spin)):
            yield "table: it states velocity and spin; leave these out"
        times = [row[0] for row in self.table]
        if len(times) == 1 or times != sorted(set(times)):
            yield "table needs two rows at least, with times that rise"


class Stage(fields.Section):
    """One act of the experiment; changes happen at its beginning."""

    later = ("steady_air",)
    name: Name = Field(description="name by which measures refer to it")
    until: Literal["rest", "time", "threshold"] = entry(
        "rest", "rest: when grains rest; time: after duration_max; threshold: when thresholds are found"
    )
    duration_min: float = number(0.0, "s", "shortest duration", 0.0, LONGEST)
    duration_max: float = number(..., "s", "time limit, or the duration itself", SHORTEST, LONGEST)
    rest_energy: float = number(1e-5, "1", "translational energy per grain over m g d at rest", 0.0, 1.0)
    rest_contact_share: float = number(0.9, "1", "least share of grains with a contact at rest", 0.0, 1.0)
    remove: tuple[Name, ...] = entry((), "names under [geometry] that vanish as the stage begins")
    move: dict[Name, Movement] = entry(
        {}, "motion of surfaces, by name under [geometry], until the next order"
    )
    tilt_rate: float = number(0.0, "deg s-1", "rate at which gravity turns about tilt_axis", -1e4, 1e4)
    tilt_axis: Direction = direction((0.0, 1.0, 0.0), "axis about which the apparatus is tilted")
    friction_velocity: float | None = number(
        None, "m s-1", "u* from now on, its profile at once steady", 0.0, FASTEST_FRICTION
    )
    steady_air: bool = entry(
        False, "the air has no inertia: its steady profile over the flying grains is set at every check"
    )
    through_flow: float | None = number(
        None, "m s-1", "superficial velocity of air rising through the bed from now on", -100.0, 100.0
    )

    def contradictions(self) -> Iterator[str]:
        if self.duration_min > self.duration_max:
            yield "duration_min exceeds duration_max"


class Measure(fields.Section):
    """When and how one observable is read; what is left out is the measure's own choice."""

    later = ("plane_normal", "walls", "axis", "centre")
    stage: Name | None = entry(None, "stage at whose end it is read; left out: the last")
    azimuths: int | None = number(None, "1", "number of silhouettes over half a turn", 1, 360)
    every: float | None = number(None, "s", "interval of repeated reading within the stage", 1e-6, LONGEST)
    plate: Name | None = entry(None, "surface on which the heap stands")
    plane_point: Vector | None = point_field(None, "a point of the plane that mass_flow counts through")
    plane_normal: Direction = direction((0.0, 0.0, -1.0), "direction in which that flow counts as positive")
    walls: tuple[Name, ...] = entry((), "walls on which a force is read; left out: all")
    axis: Direction = direction((0.0, 0.0, 1.0), "direction of that force, axis of a torque, normal of shear")
    centre: Vector = point_field(ORIGIN, "a point of the axis of a torque")
    area: float | None = number(
        None, "m2", "of the plane on which a stress acts; left out: that of the periodic box", 1e-12, 1e6
    )
    kind: Name | None = entry(None, "kind of grains that alone is read; left out: all")
    file: str | None = Field(
        default=None, max_length=400, description="Python file of a measure of your own, beside the scene"
    )
    of_this_size: bool = entry(
        False, "the angle of a heap of this many grains is asked for, not the limit of large ones"
    )


class Measured(fields.Section):
    """A laboratory's value, printed beside the simulated one."""

    value: float = number(..., "unit of the observable", "mean of the repeats")
    sd: float | None = number(None, "unit of the observable", "standard deviation of single repeats", 0.0)
    n: int | None = number(None, "1", "number of repeats", 1, 10**9)
    source: str = Field(default="", max_length=500, description="where it was published")
    same_size: bool = entry(False, "measured on a heap of as many grains as the scene's")


class Record(fields.Section):
    """What the recording keeps."""

    every: float = number(0.01, "s", "interval of frames", 1e-9, LONGEST)
    contacts: bool = entry(False, "contacts too: their grains and walls, places and forces, as lines")
    fields: bool = entry(False, "coarse-grained fields over the height too: solid fraction, velocity, stress")


class Scene(fields.SceneFile):
    """One physical situation."""

    later = ("domain",)
    scene: Head
    conditions: Conditions = Conditions()
    run: Run = Run()
    gravity: Gravity = Gravity()
    grains: Grains
    materials: dict[Name, Material] = Field(min_length=1)
    laws: LawChoice = LawChoice()
    contact: dict[fields.PairName, Contact] = Field(min_length=1)
    geometry: dict[Name, Wall] = Field({})
    domain: Domain = Domain()
    fill: Fill
    wind: Wind | None = entry(None, "air over a periodic patch; left out: no air")
    threshold: Threshold = entry(Threshold(), "search for thresholds of motion")
    stages: tuple[Stage, ...] = Field(min_length=1, max_length=1000)
    measure: dict[Name, Measure] = Field({})
    measured: dict[Name, Measured] = Field({})
    record: Record = Record()
    effects: dict[Name, dict[Name, float]] = entry({}, "optional physics: parameters by effect")

    def friction_velocity_of_stage(self, stage: int) -> float:
        """u* of a stage that reaches the patch [m s-1], as stated in it or last before it; 0 without wind."""
        by_stage = (each.friction_velocity for each in reversed(self.stages[: stage + 1]))
        friction, partition = (self.wind.friction_velocity, self.wind.partition) if self.wind else (0.0, 1.0)
        return partition * next(value for value in (*by_stage, friction) if value is not None)

    @property
    def periods_xy(self) -> tuple[float, float] | None:
        """Periods along x and y [m]: under wind those of the patch; None without any."""
        return self.domain.period if self.wind is None else (self.wind.length, self.wind.width)

    @property
    def grain_materials(self) -> dict[str, Material]:
        return {name: self.materials[name] for name in self.grains.parts}

    @property
    def grain_density(self) -> float:
        """Mean density of the grains by mass [kg m-3]."""
        return sum(part.share * self.materials[name].density for name, part in self.grains.parts.items())

    @property
    def wall_material_names(self) -> set[str]:
        return {wall.material for wall in self.geometry.values()}

    def contact_of_materials(self, a: str, b: str) -> Contact | None:
        """Parameters of a pair of materials, as stated in either order or mixed from those of two kinds."""
        pair = self.contact.get(f"{a}-{b}") or self.contact.get(f"{b}-{a}")
        alike = [self.contact.get(f"{name}-{name}") for name in (a, b) if name in self.grains.kinds]
        if pair or len(alike) < 2 or alike[0] is None or alike[1] is None:
            return pair
        return contact_of_two_kinds(alike[0], alike[1])


def reference_problems(scene: Scene, observables: Collection[str] | None) -> Iterator[str]:
    """Contradictions between sections, one line each, beginning with a dotted path.

    `observables` are those of the program; None: not checked.
    """
    if len({m.softening.rule for m in scene.materials.values() if m.softening is not None}) > 1:
        yield "materials: all softened materials must name the same rule of softening"
    unknown = list(name_problems(scene))
    yield from unknown
    checks = (contact_problems, surface_problems, threshold_problems, wind_problems, measure_problems)
    for check in () if unknown else checks:
        yield from check(scene)
    for name, entries in scene.effects.items():
        wrong = (key for key, value in entries.items() if not isfinite(value))
        yield from (f"effects.{name}.{key} must be a finite number" for key in wrong)
    listed = (name for name, order in scene.measure.items() if order.file is None)
    yield from observable_problems(listed, observables)


def name_problems(scene: Scene) -> Iterator[str]:
    """Materials, surfaces and stages that are named but not there, and stages of one name."""
    stages = [stage.name for stage in scene.stages]
    named = {"grains.material": scene.grains.material}
    named |= {f"grains.kinds.{name}": name for name in scene.grains.kinds}
    named |= {f"geometry.{name}.material": wall.material for name, wall in scene.geometry.items()}
    plates = {f"measure.{name}.plate": order.plate for name, order in scene.measure.items()}
    pressed = {f"measure.{name}.walls": wall for name, order in scene.measure.items() for wall in order.walls}
    kinds = {f"measure.{name}.kind": order.kind for name, order in scene.measure.items()}
    at_ends = {f"measure.{name}.stage": order.stage for name, order in scene.measure.items()}
    groups: tuple[tuple[Mapping[str, str | None], Collection[str], str], ...] = (
        (named, scene.materials, "[materials]"),
        (plates, scene.geometry, "[geometry]"),
        (pressed, scene.geometry, "[geometry]"),
        (kinds, scene.grains.kinds, "[grains.kinds]"),
        (at_ends, stages, "stages"),
    )
    for names, names_there, where in groups:
        for path, name in names.items():
            if name is not None and name not in names_there:
                yield f"{path} = '{name}' is not among {where}: {', '.join(names_there)}"
    for place, name in enumerate(stages):
        if name in stages[:place]:
            yield f"stages.{place}.name = '{name}' is taken by an earlier stage"


def contact_problems(scene: Scene) -> Iterator[str]:
    """Pairs of materials that are missing, doubled or without effect."""
    grains = sorted(scene.grains.parts)
    pairs = {(grain, name) for grain in grains for name in (grain, *scene.wall_material_names)}
    for grain, name in sorted(pairs):
        if scene.contact_of_materials(grain, name) is None:
            yield f"contact.{grain}-{name} is missing"
    for pair, contact in scene.contact.items():
        a, b = pair.split("-")
        if a != b and f"{b}-{a}" in scene.contact and a < b:
            yield f"contact.{pair} and contact.{b}-{a} name the same pair"
        for name in {a, b} - set(scene.materials):
            yield f"contact.{pair}: '{name}' is not among [materials]"
        of_walls = not {a, b} <= {*grains} - scene.wall_material_names
        if contact.rolling_radius == "grain" and of_walls:
            yield f"contact.{pair}.rolling_radius: at a wall both radii are the same; leave it out"
        if contact.surface_energy > 0.0 and scene.laws.normal == "hertz":
            energy = contact.surface_energy
            yield f"contact.{pair}.surface_energy = {energy:g} acts only with laws.normal = 'jkr'"


def surface_problems(scene: Scene) -> Iterator[str]:
    """Surfaces of stages that do not exist at that time."""
    standing = set(scene.geometry)
    for place, stage in enumerate(scene.stages):
        for name in stage.remove:
            if name not in standing:
                yield f"stages.{place}.remove: '{name}' is not standing: {', '.join(sorted(standing))}"
        standing -= set(stage.remove)
        for name in stage.move:
            if name not in standing:
                yield f"stages.{place}.move.{name} is not standing: {', '.join(sorted(standing))}"


def effect_problems(scene: Scene, library: Mapping[str, Collection[str]]) -> Iterator[str]:
    """Effects and parameters that the library (name -> its entries) does not have."""
    for name, values in scene.effects.items():
        if name not in library:
            remedy = "an effect of your own needs --effect FILE, or effect_files under [scene] or [study]"
            hint = f"; {remedy}; known effects: {', '.join(sorted(library)) or 'none'}"
            yield f"effects.{name} is unknown{did_you_mean(name, library) or hint}"
            continue
        for key in values:
            if key not in library[name]:
                near = did_you_mean(key, library[name])
                yield f"effects.{name}.{key} is unknown{near}; allowed: {', '.join(library[name])}"


def observable_problems(measures: Iterable[str], observables: Collection[str] | None) -> Iterator[str]:
    for name in measures if observables is not None else ():
        if name not in (observables or ()):
            yield f"measure.{name} is unknown; known observables: {', '.join(sorted(observables or ()))}"


def measure_problems(scene: Scene) -> Iterator[str]:
    """Measures that lack the stage, the wind, the plane or the interval that they need."""
    searched = any(stage.until == "threshold" for stage in scene.stages)
    for name, order in scene.measure.items():
        if name == "mass_flow" and order.plane_point is None:
            yield "measure.mass_flow.plane_point is missing: a point of the plane that grains pass"
        if name in OF_STRESS and order.area is None and scene.periods_xy is None:
            yield f"measure.{name}.area is missing: a stress is a force over an area"
        if order.kind is not None and name not in BY_KIND and order.file is None:
            yield f"measure.{name}.kind: it reads all grains together; leave it out"
        if name in FROM_THRESHOLDS and not searched:
            yield f"measure.{name} needs a stage with until = 'threshold'"
        if name in UNDER_WIND and scene.wind is None:
            yield f"measure.{name} needs a [wind] section"
        elif name in (*UNDER_WIND, *OF_WALLS, "mass_flow") and order.every is None:
            yield f"measure.{name}.every is missing: it is a mean over the stage"


def threshold_problems(scene: Scene) -> Iterator[str]:
    """A search for thresholds needs wind, is the last stage, and checks each trial at least twice."""
    places = [place for place, stage in enumerate(scene.stages) if stage.until == "threshold"]
    if not places:
        return
    place, last = places[0], len(scene.stages) - 1
    if scene.wind is None:
        yield f"stages.{place}.until = 'threshold' needs a [wind] section"
    if place != last:
        yield f"stages.{place}.until = 'threshold' must be the last stage"
    order, interval = scene.threshold, scene.run.check_interval
    for name in ("rise_hold", "hold", "spin_up", "fall_hold"):
        if getattr(order, name) < 2.0 * interval:
            entry = f"threshold.{name} = {getattr(order, name):g} s"
            yield f"{entry} is shorter than two run.check_interval of {interval:g} s"


def wind_problems(scene: Scene) -> Iterator[str]:
    """Stages, clumps and moving walls that do not go with the air, or with none."""
    wind = scene.wind
    if wind is None:
        paths = paths_of_stage_entries(scene, "friction_velocity", "through_flow", "steady_air")
        yield from (f"{path} needs a [wind] section" for path in paths)
        return
    if scene.domain.outside == "remove":
        yield "domain.outside = 'remove': measures under wind follow every grain; leave it out"
    if scene.domain.period is not None:
        yield "domain.period: under wind [wind] states length and width; leave it out"
    if scene.grains.clump is not None:
        yield "wind: drag acts on single spheres; grains.clump must be left out"
    if wind.sleep_after is not None:
        for path in paths_of_stage_entries(scene, "move"):
            yield f"{path}: no grain may sleep where walls move; leave wind.sleep_after out"
    yield from column_problems(wind) if wind.columns == (1, 1) else grid_problems(scene, wind)


def column_problems(wind: Wind) -> Iterator[str]:
    """Whatever needs a grid of air, stated for a single column."""
    if wind.closure == "smagorinsky":
        yield "wind.closure = 'smagorinsky': one column has no eddies; state wind.columns"
    if wind.drive == "gradient":
        yield "wind.drive = 'gradient': one column is driven by its lid; state wind.columns"


def paths_of_stage_entries(scene: Scene, *names: str) -> list[str]:
    """Paths of some entries in the stages that state them."""
    stages, unstated = list(enumerate(scene.stages)), (None, {}, False)
    entries = ((k, name) for name in names for k, stage in stages if getattr(stage, name) not in unstated)
    return [f"stages.{k}.{name}" for k, name in entries]


def grid_problems(scene: Scene, wind: Wind) -> Iterator[str]:
    """Whatever needs a single column of air, stated for a grid."""
    for place, count in enumerate(wind.columns):
        if count < COLUMNS_LEAST or count % 2:
            yield f"wind.columns.{place} = {count}: an even number is needed, at least {COLUMNS_LEAST}"
    paths = ["wind.through_flow"] if wind.through_flow else []
    for path in paths + paths_of_stage_entries(scene, "through_flow"):
        yield f"{path} needs a single column of air; leave wind.columns out"
    for name in OF_ONE_COLUMN:
        if name in scene.measure:
            yield f"measure.{name} reads a single column of air; leave wind.columns out"
    for path in paths_of_stage_entries(scene, "steady_air"):
        yield f"{path} needs a single column of air; leave wind.columns out"
    if "turbulent_gusts" in scene.effects and wind.closure != "mixing_length":
        yield "effects.turbulent_gusts: the grid has gusts of its own; leave the effect or the eddies out"
