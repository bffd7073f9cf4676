"""Conditions of an experiment: those that every scene may state, and those that a user declares."""

from typing import Any

from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer, model_validator

from taichi_erosion.scene.schema import fields
from taichi_erosion.scene.schema.fields import Name, Section, contradiction, number
from taichi_erosion.scene.schema.units import EXAMPLES, UnknownUnit, parse_scale

LARGEST = 1e30  # values beyond it are taken for a slip
DECLARE = '; a condition of your own: [conditions.extra] NAME = { unit = "...", value = ... }'
# what effects read beside the conditions
OF_SCENE = ("grain_diameter", "adhesion_scale", "bed_height", "density_ratio")


class ExtraCondition(Section):
    """A condition that a user declares; effects read it in SI units."""

    unit: str = Field(max_length=60, description="unit of its value, and of a study's column that sets it")
    value: float | None = number(None, "unit", "value; left out: unknown or of a column", -LARGEST, LARGEST)
    meaning: str = Field("", max_length=200, description="one line for people")

    @field_validator("unit")
    @classmethod
    def _require_known_unit(cls, unit: str) -> str:
        try:
            parse_scale(unit)
        except UnknownUnit as error:
            hint = error.hint or f"allowed: {EXAMPLES}"
            raise contradiction(f"'{unit}' is not a known unit; {hint}") from None
        return unit

    def value_in_si(self, value: Any) -> Any:
        """A value, or an array of values, in SI units."""
        scale = parse_scale(self.unit)
        return scale.origin + scale.factor * value


class Conditions(Section):
    """What a laboratory writes beside a measurement; effects read them."""

    in_metres_only = True
    moisture: float | None = number(None, "kg kg-1", "mass of water over mass of solid", 0.0, 5.0)
    temperature: float | None = number(None, "K", "air temperature", 200.0, 400.0)
    relative_humidity: float | None = number(None, "1", "relative humidity of the air", 0.0, 1.0)
    pressure: float | None = number(None, "Pa", "air pressure", 1e2, 2e5)
    altitude: float | None = number(None, "m", "height above sea level", -500.0, 9000.0)
    slope: float | None = number(None, "deg", "slope of the bed, uphill positive", -90.0, 90.0)
    wind_speed: float | None = number(None, "m s-1", "free-stream wind speed", 0.0, 100.0)
    friction_velocity: float | None = number(None, "m s-1", "friction velocity u*", 0.0, 10.0)
    diameter: float | None = fields.grain_diameter(None, "grain diameter as the laboratory states it")
    angularity: float | None = number(None, "1", "shape index: 0 round, 1 most angular", 0.0, 1.0)
    clay_fraction: float | None = number(None, "kg kg-1", "mass fraction of clay", 0.0, 1.0)
    organic_fraction: float | None = number(None, "kg kg-1", "mass fraction of organic matter", 0.0, 1.0)
    salinity: float | None = number(None, "kg kg-1", "mass fraction of salts", 0.0, 1.0)
    roughness_density: float | None = number(
        None, "1", "frontal area of stones or plants over ground area", 0.0, 10.0
    )
    fetch: float | None = number(None, "m", "length of loose bed upwind of the trap", 0.0, 1e6)
    rest_duration: float | None = number(None, "s", "time at rest before the test", 0.0, 1e9)
    extra: dict[Name, ExtraCondition] = Field(default={}, description="conditions of the user's own, by name")

    @model_validator(mode="before")
    @classmethod
    def _accept_bare_values(cls, table: Any) -> Any:
        """The table with `NAME = 3.0` taken for the value of [conditions.extra] NAME."""
        if not isinstance(table, dict):
            return table
        declared = table.get("extra", {})
        extra = dict(declared) if isinstance(declared, dict) else {}
        entries = {key: value for key, value in table.items() if key in cls.model_fields}
        for key, value in table.items():
            if key in extra and isinstance(extra[key], dict):
                extra[key] = {**extra[key], "value": value}
            elif key not in cls.model_fields and key not in extra:
                raise fields.unknown_key_error(str(key), [*cls.model_fields, *extra], DECLARE)
        return entries | ({"extra": extra} if extra else {})

    @field_validator("extra")
    @classmethod
    def _refuse_reserved_names(cls, extra: dict[str, ExtraCondition]) -> dict[str, ExtraCondition]:
        for name in extra:
            if name in cls.model_fields:
                unit = fields.unit_of_number_field(cls.model_fields[name])
                raise contradiction(f"{name} is among [conditions] already, in {unit}; state it there")
            if name in OF_SCENE:
                raise contradiction(f"{name} is a number that effects get from the scene; take another name")
        return extra

    @model_serializer(mode="wrap")
    def _omit_empty_extra(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        table = dump(self)
        if not self.extra:
            table.pop("extra", None)
        return table

    def values_in_si(self) -> dict[str, float]:
        """Conditions that have a value, by name; those of [conditions.extra] in SI units."""
        extra = {name: e.value_in_si(e.value) for name, e in self.extra.items() if e.value is not None}
        table = {name: getattr(self, name) for name in type(self).model_fields if name != "extra"}
        return {name: float(value) for name, value in table.items() if value is not None} | extra
