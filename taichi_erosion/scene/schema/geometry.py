"""Walls of a scene; a wall is one surface with one material, and moves as one body."""

from collections.abc import Iterator
from pathlib import PurePath
from typing import Annotated, Literal

from pydantic import Field

from taichi_erosion.scene.schema import fields
from taichi_erosion.scene.schema.fields import Direction, Name, Section, Vector

ORIGIN: Vector = (0.0, 0.0, 0.0)
UPWARDS: Vector = (0.0, 0.0, 1.0)
Face = Literal["x_low", "x_high", "y_low", "y_high", "z_low", "z_high"]
OPEN_BOX: tuple[Face, ...] = ("x_low", "x_high", "y_low", "y_high", "z_low")


class Plane(Section):
    """Half space: everything behind the plane is solid."""

    shape: Literal["plane"]
    material: Name
    point: Vector = fields.point_field(ORIGIN, "a point of the plane")
    normal: Direction = fields.direction(UPWARDS, "normal into the free side")


class Disc(Section):
    """Thin round plate, or a ring."""

    later = ("hole",)
    shape: Literal["disc"]
    material: Name
    centre: Vector = fields.point_field(ORIGIN, "centre")
    axis: Direction = fields.direction(UPWARDS, "normal of the disc")
    radius: float = fields.extent(..., "radius")
    hole: float = fields.extent(0.0, "radius of a round hole in its middle; 0: none", low=0.0)

    def contradictions(self) -> Iterator[str]:
        if self.hole >= self.radius:
            yield "hole must be smaller than radius"


class Cylinder(Section):
    """Thin open tube; `centre` is the middle of its low end, `axis` points to the other."""

    shape: Literal["cylinder"]
    material: Name
    centre: Vector = fields.point_field(ORIGIN, "middle of the end where the axis starts")
    axis: Direction = fields.direction(UPWARDS, "direction of the axis")
    radius: float = fields.extent(..., "inner radius")
    length: float = fields.extent(..., "length along the axis")


class Cone(Section):
    """Thin cone frustum."""

    shape: Literal["cone"]
    material: Name
    centre: Vector = fields.point_field(ORIGIN, "middle of the end where the axis starts")
    axis: Direction = fields.direction(UPWARDS, "direction of the axis")
    radius_low: float = fields.extent(..., "radius where the axis starts", low=0.0)
    radius_high: float = fields.extent(..., "radius at the other end", low=0.0)
    length: float = fields.extent(..., "length along the axis")

    def contradictions(self) -> Iterator[str]:
        if self.radius_low + self.radius_high == 0.0:
            yield "radius_low and radius_high are both 0"


class Funnel(Section):
    """Upright cone frustum on a stem; `outlet` is the middle of the lower opening."""

    shape: Literal["funnel"]
    material: Name
    outlet: Vector = fields.point_field(ORIGIN, "middle of the lower opening")
    outlet_radius: float = fields.extent(..., "inner radius of the opening and of the stem")
    stem_length: float = fields.extent(0.0, "length of the stem; 0: none", low=0.0)
    rim_radius: float = fields.extent(..., "inner radius of the upper rim")
    cone_height: float = fields.extent(..., "height of the cone")

    def contradictions(self) -> Iterator[str]:
        if self.rim_radius < self.outlet_radius:
            yield "rim_radius is smaller than outlet_radius"


class Box(Section):
    """Inside of a rectangular box; a face is a half space, so walls do not end at their edges."""

    shape: Literal["box"]
    material: Name
    low: Vector = fields.point_field(..., "corner of the smallest coordinates")
    high: Vector = fields.point_field(..., "corner of the largest coordinates")
    faces: tuple[Face, ...] = Field(OPEN_BOX, min_length=1, max_length=6, description="faces that exist")

    def contradictions(self) -> Iterator[str]:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            yield "low must be smaller than high in every coordinate"
        if len(set(self.faces)) < len(self.faces):
            yield "faces names a face twice"


class Hull(Section):
    """Triangles of a file (STL, PLY, OBJ), looked for beside the scene."""

    file: str = Field(min_length=1, max_length=200, description="path relative to the scene file")
    scale: float = fields.number(1.0, "m per file unit", "size of the file's unit of length", 1e-9, 1e6)
    translate: Vector = fields.point_field(ORIGIN, "shift after scaling")

    def contradictions(self) -> Iterator[str]:
        path = PurePath(self.file)
        if path.is_absolute() or ".." in path.parts or "\0" in self.file:
            yield f"file = '{self.file}' must lie beside or below the scene file"


class Mesh(Hull):
    """Triangles of a file as a wall."""

    shape: Literal["mesh"]
    material: Name


class Domain(Section):
    """The box around the apparatus, with room to its sides."""

    outside: Literal["remove", "stop"] | None = Field(
        default=None,
        description="what a grain does that leaves it: remove, it is taken out and counted; stop, it ends "
        "the run; left out: remove where the floor is finite",
    )
    period: tuple[float, float] | None = fields.number(
        None,
        "m",
        "periods along x and y, from 0: what leaves on one side returns on the other; left out: none",
        1e-7,
        fields.LARGEST_APPARATUS,
    )


Wall = Annotated[Plane | Disc | Cylinder | Cone | Funnel | Box | Mesh, Field(discriminator="shape")]
