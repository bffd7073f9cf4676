"""Grains, materials and contacts of a scene."""

from collections.abc import Iterator
from math import dist, hypot, pi, sqrt
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from taichi_erosion.scene.schema import fields
from taichi_erosion.scene.schema.fields import Name, Section, Vector, entry, extent, number, point_field
from taichi_erosion.scene.schema.geometry import Hull

LIGHTEST = 25.0  # no solid has more than 23 g cm-3: smaller numbers are taken for that unit [kg m-3]
MOST_GRAINS = 5_000_000  # about 5 GB of state
MOST_MASS = 1e6  # total of a sieve column, in whatever unit of mass [any]

SieveRow = tuple[float, float, float]


class Monodisperse(Section):
    """All grains alike."""

    in_metres_only = True
    law: Literal["monodisperse"]
    diameter: float = fields.grain_diameter(..., "grain diameter")


class Lognormal(Section):
    """Numbers of grains distributed lognormally, cut at both ends."""

    in_metres_only = True
    law: Literal["lognormal"]
    median: float = fields.grain_diameter(..., "median by number, before truncation")
    sigma_log: float = number(..., "1", "standard deviation of ln diameter", 0.0, 2.0)
    low: float = fields.grain_diameter(..., "smallest diameter")
    high: float = fields.grain_diameter(..., "largest diameter")

    def contradictions(self) -> Iterator[str]:
        if not self.low <= self.median <= self.high:
            yield "low <= median <= high must hold"


class Sieve(Section):
    """Mass by size class; inside a class mass is uniform over the logarithm of the diameter.

    `low` and `high` cut the tabulated curve, then `scale` magnifies what is left (coarse graining).
    """

    in_metres_only = True
    law: Literal["sieve"]
    table: Name | None = entry(None, "name of a shipped sieve table")
    rows: tuple[SieveRow, ...] = number((), "m, m, any mass", "size classes: low, high, mass", 0.0, MOST_MASS)
    low: float | None = fields.grain_diameter(None, "lower cut of the tabulated curve")
    high: float | None = fields.grain_diameter(None, "upper cut of the tabulated curve")
    scale: float = number(1.0, "1", "simulated over tabulated diameter (coarse graining)", 1e-2, 1e3)

    def contradictions(self) -> Iterator[str]:
        if bool(self.rows) == (self.table is not None):
            yield "needs either table or rows"
        least, most = fields.SMALLEST_GRAIN, fields.LARGEST_GRAIN
        for row in self.rows:
            if not least <= row[0] < row[1] <= most:
                yield f"row {list(row)} needs {least} <= low < high <= {most} m"
        if any(b[0] < a[1] for a, b in zip(self.rows, self.rows[1:], strict=False)):
            yield "rows must ascend without overlap"
        if self.low is not None and self.high is not None and self.low >= self.high:
            yield "low must be smaller than high"


Size = Annotated[Monodisperse | Lognormal | Sieve, Field(discriminator="law")]


class ClumpSphere(Section):
    """One sphere of a clump template, in nominal grain diameters."""

    offset: Vector = number(..., "d", "centre, in nominal diameters", -10.0, 10.0)
    radius: float = number(..., "d", "radius, in nominal diameters", 0.05, 10.0)


class Clump(Section):
    """Rigid grain made of several spheres: a shipped template or a list."""

    template: Literal["pair", "tripod", "tetrahedron"] | None = entry(None, "a shipped template")
    spheres: tuple[ClumpSphere, ...] = Field((), max_length=64, description="spheres of an own template")

    def contradictions(self) -> Iterator[str]:
        if bool(self.spheres) == (self.template is not None):
            yield "needs either template or spheres"


class Kind(Section):
    """Grains of one material among others."""

    share: float = number(..., "1", "share of the mass; shares are scaled to 1", 1e-9, MOST_MASS)
    size: Size = Field(description="distribution of nominal diameters")


class CoarseGraining(Section):
    """Grains larger than the true ones, whose diameters the sizes state; forces of adhesion follow by a rule.

    Adhesion of the true grains is stated: the surface energy, and effects whose pull is proportional to R.
    `cohesive_stress` keeps the tensile strength of the bulk, for heaps and shear tests in an apparatus of the
    true size: both are multiplied by `factor`. `bond_number` keeps the pull-off force over the weight, for
    grains that a wind lifts: by its square.
    """

    rule: Literal["cohesive_stress", "bond_number"] = Field(description="what is kept by larger grains")
    factor: float = number(..., "1", "simulated over true diameter", 1.0, 1e3)

    @property
    def adhesion_scale(self) -> float:
        """Factor of the pull of a contact over its R* [1]; sigma_t ~ F / d^2 and Bo ~ F / d^3, with F ~ d."""
        return self.factor if self.rule == "cohesive_stress" else self.factor**2


class Grains(Section):
    """What is poured: grains of one material, or several kinds of them."""

    model_config = ConfigDict(
        json_schema_extra={"oneOf": [{"required": ["size", "material"]}, {"required": ["kinds"]}]}
    )
    later = ("kinds",)
    count: int = number(..., "1", "number of grains; a clump counts as one", 1, MOST_GRAINS)
    kinds: dict[Name, Kind] = entry(
        {}, "kinds of grains by their names under [materials], in place of size and material"
    )
    size: Size | None = Field(default=None, validate_default=True, description="distribution of diameters")
    material: Name | None = Field(
        default=None, validate_default=True, description="name of a table under [materials]"
    )
    clump: Clump | None = entry(None, "template of non-spherical grains; left out: spheres")
    coarse_graining: CoarseGraining | None = entry(
        None, "names the scaling rule where grains are larger than the true ones"
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_table_list(cls, table: Any) -> Any:
        if isinstance(table, (list, tuple)):
            raise fields.contradiction("kinds stand in tables [grains.kinds.MATERIAL], and count in [grains]")
        return table

    @field_validator("size", "material")
    @classmethod
    def _refuse_mixed_statement(cls, value: Any, about: ValidationInfo) -> Any:
        if value is None and not about.data.get("kinds", True):
            raise PydanticCustomError("missing", "missing")
        if value is not None and about.data.get("kinds"):
            raise fields.contradiction("stands in every kind of [grains.kinds]; leave it out here")
        return value

    @property
    def adhesion_scale(self) -> float:
        """Factor of the pull of a contact over its R* [1]: 1 for grains of the true size."""
        return self.coarse_graining.adhesion_scale if self.coarse_graining else 1.0

    @property
    def parts(self) -> dict[str, Kind]:
        """Kinds by material; shares add up to 1."""
        if self.material is not None and self.size is not None:
            return {self.material: Kind.model_construct(share=1.0, size=self.size)}
        total = sum(kind.share for _, kind in sorted(self.kinds.items()))
        shares = {name: {"share": kind.share / total} for name, kind in sorted(self.kinds.items())}
        return {name: self.kinds[name].model_copy(update=share) for name, share in shares.items()}


class Softening(Section):
    """Why the simulated stiffness differs from the real one, and what is kept.

    `bond_number` keeps the pull-off force over the weight: the surface energy stays.
    `sticking_velocity` keeps the speed below which a grain sticks: the surface energy is multiplied by
    (E*_simulated / E*_true)^(2/5).
    """

    rule: Literal["bond_number", "sticking_velocity"] = Field(description="kept as stiffness is reduced")
    true_modulus: float = number(
        ..., "Pa", "real modulus, of the kind (shear or Young) that the material states", 1e3, 1e14
    )


class Material(Section):
    """Elastic material of grains or walls; one modulus is given, the other follows."""

    density: float = number(..., "kg m-3", "density of the solid", LIGHTEST, 3e4)
    shear_modulus: float | None = number(None, "Pa", "shear modulus as simulated", 1e3, 1e12)
    young_modulus: float | None = number(None, "Pa", "Young's modulus as simulated", 1e3, 1e12)
    poisson_ratio: float = number(..., "1", "Poisson ratio", 0.0, 0.5)
    softening: Softening | None = entry(None, "names the scaling rule where stiffness is reduced")

    def contradictions(self) -> Iterator[str]:
        if (self.shear_modulus is None) == (self.young_modulus is None):
            yield "needs shear_modulus or young_modulus, and only one of them"


class Contact(Section):
    """Contact parameters of one pair of materials."""

    restitution: float = number(..., "1", "coefficient of normal restitution", 0.0, 1.0)
    friction_sliding: float = number(..., "1", "coefficient of sliding friction", 0.0, 5.0)
    friction_rolling: float = number(0.0, "1", "limiting rolling torque over radius and force", 0.0, 5.0)
    rolling_radius: Literal["effective", "grain"] = entry(
        "effective",
        "that radius: R*, half a grain's between equal ones; or the grain's own (EDEM standard), "
        "2 R*, which is that of both grains only where they are equal",
    )
    rolling_damping: float = number(0.3, "1", "rolling damping over critical (Ai et al. 2011)", 0.0, 1.0)
    surface_energy: float = number(
        0.0,
        "J m-2",
        "surface energy gamma of one surface, as in EDEM and LAMMPS; work of adhesion w = 2 gamma, "
        "pull-off force 3 pi gamma R*",
        0.0,
        1e3,
    )
    effects: bool | None = entry(None, "false: no effect acts on it, it is as stated in every run")

    @property
    def rolling_radius_ratio(self) -> float:
        """The radius of friction_rolling over R*: a grain's own is twice R* between equal grains [1]."""
        return 2.0 if self.rolling_radius == "grain" else 1.0

    @property
    def acted_on(self) -> bool:
        """Whether effects act on it."""
        return self.effects is not False


def contact_of_two_kinds(a: Contact, b: Contact) -> Contact:
    """Contact of grains of two kinds from those of each with its own: geometric means.

    Restitution, friction, rolling friction over R* and rolling damping are mixed as LAMMPS does (pair
    granular); of the surface energy it is the rule of Good & Girifalco (1960), J. Phys. Chem. 64, 561.
    """
    names = ("restitution", "friction_sliding", "friction_rolling", "rolling_damping", "surface_energy")
    mean = {name: sqrt(getattr(a, name) * getattr(b, name)) for name in names}
    mean["friction_rolling"] *= sqrt(a.rolling_radius_ratio * b.rolling_radius_ratio)
    return a.model_copy(
        update=mean | {"rolling_radius": "effective", "effects": None if a.acted_on and b.acted_on else False}
    )


class GrainStart(Section):
    """One explicitly placed grain."""

    in_metres_only = True
    later = ("kind",)
    position: Vector = point_field(..., "centre (of the template's origin for a clump)")
    velocity: Vector = number((0.0, 0.0, 0.0), "m s-1", "velocity", -1e3, 1e3)
    spin: Vector = number((0.0, 0.0, 0.0), "rad s-1", "angular velocity", -1e6, 1e6)
    diameter: float | None = fields.grain_diameter(None, "diameter; left out: nominal")
    kind: Name | None = entry(None, "its name under [grains.kinds]")


class Positions(Section):
    """Explicit list, for scenes of one or a few grains."""

    law: Literal["positions"]
    grains: tuple[GrainStart, ...] = Field(min_length=1, max_length=10_000, description="one table per grain")


class JitteredNet(Section):
    """Random parts of a net of places."""

    jitter: float = extent(0.0, "largest shift of a grain along each coordinate", low=0.0)
    speed_sd: float = number(0.5, "1", "sd of each velocity component over sqrt(g d)", 0.0, 100.0)


class Rain(JitteredNet):
    """Loose random layers that fall: square nets, each turned and shifted at random, with jitter."""

    law: Literal["rain"]
    pitch: float = extent(..., "distance of neighbours in a layer, and of layers")
    radius: float = extent(..., "largest distance of a centre from the axis")
    axis_point: Vector = number((0.0, 0.0, 0.0), "m", "point of the vertical axis; heights count from it")
    first_height: float = extent(..., "height of the first layer")


class Lattice(JitteredNet):
    """Rain inside a cylinder of any axis (a drum): a cubic net with jitter, filled from below."""

    law: Literal["lattice"]
    pitch: float = extent(..., "distance of neighbours")
    centre: Vector = point_field((0.0, 0.0, 0.0), "centre of the cylinder")
    axis: fields.Direction = fields.direction((0.0, 0.0, 1.0), "direction of the axis")
    radius: float = extent(..., "radius that holds the centres")
    length: float = extent(..., "length that holds the centres")


class Inlet(Section):
    """Grains pass a disc, a rectangle, a line or a closed mesh, layer by layer, apart, at random places."""

    centre: Vector | None = point_field(None, "middle of the disc or rectangle, or one end of the line")
    radius: float | None = extent(None, "radius of a horizontal disc, whole grains inside")
    size: tuple[float, float] | None = extent(None, "sides of a horizontal rectangle along x and y, likewise")
    end: Vector | None = point_field(None, "other end of a line, on which grains lie side by side")
    mesh: Hull | None = entry(None, "closed mesh, whole grains inside")
    speed: float = number(2.0, "m s-1", "downward speed there", 0.0, 100.0)
    rate: float | None = number(None, "s-1", "grains a second; left out: as fast as layers clear", 1e-3, 1e9)
    mass_rate: float | None = number(None, "kg s-1", "mass per second, in place of rate", 1e-12, 1e6)
    coverage: float = number(0.25, "1", "share of area, length or volume that a layer covers", 1e-3, 0.45)
    begin: float = number(0.0, "s", "time at which it opens", 0.0, 1e5)
    share: float = number(1.0, "1", "its share of the grains among inlets, in any unit", 1e-6, MOST_MASS)
    kind: Name | None = entry(None, "kind of grains that alone passes; left out: all")

    def contradictions(self) -> Iterator[str]:
        shapes = [name for name in ("radius", "size", "end", "mesh") if getattr(self, name) is not None]
        alone = 0 if getattr(self, "inlets", {}) else 1
        if (len(shapes), self.centre is None) != (alone, alone == 0 or self.mesh is not None):
            words = "centre and one of radius (disc), size (rectangle), end (line), or mesh without centre"
            yield f"needs {words}; beside inlets none of these"
        if self.centre and self.end and self.centre[2] != self.end[2]:
            yield "the line from centre to end must be horizontal"
        if self.rate is not None and self.mass_rate is not None:
            yield "rate and mass_rate state the same; leave one out"

    @property
    def middle(self) -> Vector:
        """Middle of the shape [m]."""
        x, y, z = self.centre or (0.0, 0.0, 0.0)
        a, b, c = self.end or (x, y, z)
        return 0.5 * (x + a), 0.5 * (y + b), 0.5 * (z + c)

    @property
    def reach(self) -> float:
        """Distance of its farthest point from the middle [m]."""
        return self.radius or 0.5 * hypot(*(self.size or ())) or dist(self.middle, self.end or self.middle)

    def area(self, width: float) -> float:
        """Area of the shape [m2], that of a line for grains of a width [m]."""
        if self.radius is not None:
            return pi * self.radius**2
        return self.size[0] * self.size[1] if self.size else 2.0 * self.reach * width


class Pour(Inlet):
    """Grains pass one inlet, or several."""

    later = ("begin", "share", "kind", "inlets")
    law: Literal["pour"]
    inlets: dict[Name, Inlet] = entry({}, "inlets by names, in place of one")

    @property
    def parts(self) -> dict[str, Inlet]:
        """All inlets by the path of their entries."""
        return {f"fill.inlets.{name}": each for name, each in sorted(self.inlets.items())} or {"fill": self}


class Layers(JitteredNet):
    """Loose jittered layers over a whole periodic patch."""

    law: Literal["layers"]
    pitch: float = extent(..., "least distance of neighbours in a layer, and of layers")
    first_height: float = extent(..., "height of the first layer")


class Bed(Section):
    """Grains of another run as they lay in its checkpoint, with the springs of their contacts."""

    law: Literal["bed"]
    file: str = Field(min_length=1, max_length=400, description="the checkpoint, relative to the scene file")


Fill = Annotated[Positions | Rain | Lattice | Pour | Layers | Bed, Field(discriminator="law")]
