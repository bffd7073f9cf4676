"""Fields of a scene file: every number with its unit, meaning and range.

Every section of a scene is a `Section`: frozen, strict about types, closed to unknown keys. `radius_d = 9.0`
means a radius of nine nominal grain diameters; the suffix serves every quantity in m or s.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import pydantic
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    StringConstraints,
    ValidationInfo,
)
from pydantic_core import CoreSchema, PydanticCustomError

from taichi_erosion.core.effect_file import EffectFile
from taichi_erosion.core.errors import nearest_word

Vector = tuple[float, float, float]
Name = Annotated[str, StringConstraints(pattern=r"^[^\W\d_]\w{0,59}$")]
PairName = Annotated[str, StringConstraints(pattern=r"^[^\W\d_]\w{0,59}-[^\W\d_]\w{0,59}$")]

DIAMETERS = "_d"  # suffix of a length in nominal diameters, or of a time in s per m of diameter
SCALING_UNITS = ("m", "s")  # of quantities that may be given so
FOR_HASH = {"hash": True}  # context of serialization
DIAMETER = "diameter"  # the nominal one [m], in the context of validation
FARTHEST = 1e4  # coordinates beyond it are taken for a wrong unit [m]
LARGEST_APPARATUS = 3.0  # likewise walls, fills and patches whose grains are followed one by one [m]
SMALLEST_GRAIN = 1e-6  # smaller grains are no longer moved by contact and weight alone [m]
LARGEST_GRAIN = 0.05  # larger ones are taken for a wrong unit; wind moves none of them [m]
FASTEST = 1e3  # likewise speeds [m s-1]


@dataclass(frozen=True)
class PhysicalRange:
    """Possible and usual values of a quantity, ends included."""

    unit: str
    low: float
    high: float
    usual: tuple[float, float] | None = None

    def is_possible(self, value: float) -> bool:
        return self.low <= value <= self.high

    def is_usual(self, value: float) -> bool:
        """Whether a value is possible and, where a usual range is known, within it; zero always is."""
        low, high = self.usual or (self.low, self.high)
        return self.is_possible(value) and (low <= value <= high or value == 0.0)


def contradiction(message: str) -> PydanticCustomError:
    """Error of a section whose entries do not fit together."""
    return PydanticCustomError("contradiction", "{message}", {"message": message})


def refuse_null_vector(vector: Vector) -> Vector:
    """The vector itself. Raises a contradiction for the null vector."""
    if sum(c * c for c in vector) < 1e-24:
        raise contradiction(f"{list(vector)} has no direction")
    return vector


Direction = Annotated[Vector, AfterValidator(refuse_null_vector)]


def number(default: Any, unit: str, meaning: str, low: float = -inf, high: float = inf) -> Any:
    """Declare a number, or a vector of such numbers; `...` as default means that the scene must state it.

    The bounds are inclusive, serve every component of a vector, and appear in the JSON schema.
    """
    bounds = {key: bound for key, bound in (("minimum", low), ("maximum", high)) if isfinite(bound)}
    return Field(default, description=f"{meaning} [{unit}]", json_schema_extra={"unit": unit, **bounds})


def entry(default: Any, meaning: str) -> Any:
    """Declare an entry that is no number, with its default and its meaning."""
    return Field(default, description=meaning)


def unit_of_number_field(field: Any) -> str | None:
    """Unit of a field declared by `number`, None for text and sections."""
    extra = field.json_schema_extra
    return extra.get("unit") if isinstance(extra, dict) else None


def all_numbers_in(value: Any) -> Iterator[float]:
    """The numbers of a number, of nested lists and tables, or of nothing."""
    if isinstance(value, list | tuple | dict):
        for component in value.values() if isinstance(value, dict) else value:
            yield from all_numbers_in(component)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


def multiply_numbers(value: Any, factor: float) -> Any:
    """A number, or a list of numbers, multiplied; None for anything else."""
    if isinstance(value, tuple):
        parts = tuple(multiply_numbers(entry, factor) for entry in value)
        return None if None in parts else parts or None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) * factor if is_number else None


def unknown_key_error(key: str, keys: Iterable[str], also: str = "") -> PydanticCustomError:
    """Error of a key that a section does not have; `also` is a remedy where no known key is near."""
    near = nearest_word(key, keys)
    hint = f"did you mean '{near}'?" if near else f"allowed: {', '.join(keys)}{also}"
    return PydanticCustomError("unknown", "{hint}", {"hint": hint, "key": key})


class Section(BaseModel):
    """One section of a scene file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    in_metres_only: ClassVar[bool] = False  # no length or time of it may be given in grain diameters
    later: ClassVar[tuple[str, ...]] = ()  # entries that older scenes lack: at their default not in a hash

    @pydantic.model_serializer(mode="wrap")
    def _omit_fields_outside_hash(
        self, dump: pydantic.SerializerFunctionWrapHandler, about: pydantic.SerializationInfo
    ) -> Any:
        table = dump(self)
        for name in self.later if about.context == FOR_HASH else ():
            if getattr(self, name) == type(self).model_fields[name].get_default(call_default_factory=True):
                table.pop(name, None)
        return table

    @pydantic.model_validator(mode="before")
    @classmethod
    def _scale_by_nominal_diameter(cls, table: Any, about: ValidationInfo) -> Any:
        """The table with every `NAME_d` replaced by NAME, times the nominal diameter where it is known."""
        if not isinstance(table, dict):
            return table
        diameter: float | None = (about.context or {}).get(DIAMETER)
        converted = {}
        for key, value in table.items():
            scaled = multiply_numbers(value, diameter) if diameter else None
            name = cls.name_without_diameter_suffix(str(key)) if scaled is not None else None
            if name is not None and name in table:
                raise contradiction(f"{name} and {key} name the same quantity")
            if name is None and key not in cls.model_fields:
                raise unknown_key_error(str(key), cls.model_fields)
            converted[name or key] = scaled if name else value
        return converted

    @classmethod
    def name_without_diameter_suffix(cls, key: str) -> str | None:
        """The length or time that a key gives in nominal diameters, None for any other key."""
        field = cls.model_fields.get(key.removesuffix(DIAMETERS)) if key.endswith(DIAMETERS) else None
        if field is None or cls.in_metres_only or unit_of_number_field(field) not in SCALING_UNITS:
            return None
        return key.removesuffix(DIAMETERS)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: pydantic.GetJsonSchemaHandler) -> Any:
        """Schema of the section with `NAME_d` for every length and time that it has."""
        part = handler.resolve_ref_schema(handler(core))
        either = []
        for name, entry in list(part.get("properties", {}).items()):
            if cls.name_without_diameter_suffix(name + DIAMETERS) is None:
                continue
            unit = "1" if entry["unit"] == "m" else "s m-1"
            unbounded = {k: v for k, v in entry.items() if k not in ("minimum", "maximum", "default")}
            meaning = f"{entry['description'].rpartition(' [')[0]}, over the nominal grain diameter [{unit}]"
            part["properties"][name + DIAMETERS] = unbounded | {"description": meaning, "unit": unit}
            if name in part.get("required", []):
                part["required"] = [required for required in part["required"] if required != name]
                either.append({"oneOf": [{"required": [name]}, {"required": [name + DIAMETERS]}]})
        if either:
            part["allOf"] = either
        return part

    @pydantic.field_validator("*")
    @classmethod
    def _refuse_out_of_range(cls, value: Any, about: ValidationInfo) -> Any:
        extra = cls.model_fields[str(about.field_name)].json_schema_extra
        if isinstance(extra, dict):
            low, high = float(str(extra.get("minimum", -inf))), float(str(extra.get("maximum", inf)))
            if not all(low <= v <= high for v in all_numbers_in(value)):
                unit = "" if extra["unit"] == "1" else f" {extra['unit']}"
                allowed = f"[{low:g}, {high:g}]{unit}"
                raise PydanticCustomError("outside", "lies outside {range}", {"range": allowed})
        return value

    @pydantic.model_validator(mode="after")
    def _refuse_contradictions(self) -> Self:
        for message in self.contradictions():
            raise contradiction(message)
        return self

    def contradictions(self) -> Iterator[str]:
        """What is wrong with entries that do not fit together; the first is told."""
        yield from ()


def point_field(default: Any, meaning: str) -> Any:
    """Declare a point or a shift [m]."""
    return number(default, "m", meaning, -FARTHEST, FARTHEST)


def extent(default: Any, meaning: str, low: float = 1e-7, high: float = LARGEST_APPARATUS) -> Any:
    """Declare an extent [m], positive and no larger than an apparatus unless its bounds are given."""
    return number(default, "m", meaning, low, high)


def grain_diameter(default: Any, meaning: str) -> Any:
    """Declare a diameter of grains [m]."""
    return number(default, "m", meaning, SMALLEST_GRAIN, LARGEST_GRAIN)


def direction(default: Any, meaning: str) -> Any:
    """Declare a direction vector of any length above 0."""
    return number(default, "1", meaning, -FARTHEST, FARTHEST)


def unit_vector(vector: Vector) -> Vector:
    """The vector over its length [1]."""
    size = sum(c * c for c in vector) ** 0.5
    return (vector[0] / size, vector[1] / size, vector[2] / size)


class SceneFile(Section):
    """A whole scene file."""

    _folder: Path = PrivateAttr(default=Path())
    _file: str = PrivateAttr(default="scene")
    _effect_files: tuple[EffectFile, ...] = PrivateAttr(default=())
    _effect_digests: dict[str, str] = PrivateAttr(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Folder of the scene file, where meshes are looked for."""
        return self._folder

    @property
    def file(self) -> str:
        """Name of the scene file as the user wrote it, for messages."""
        return self._file

    @property
    def effect_files_of_scene(self) -> tuple[EffectFile, ...]:
        """Files of the effects that the scene names and that are not in the package."""
        return self._effect_files

    @property
    def effect_digests(self) -> dict[str, str]:
        """Digests of the effects that the scene names and that are not in the package, by name."""
        return self._effect_digests


def resolve(scene: SceneFile) -> dict[str, Any]:
    """The scene with all defaults filled, as plain lists, tables and numbers; `parse_scene` reads it back."""
    return scene.model_dump(mode="json", exclude_none=True)
