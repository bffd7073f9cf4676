"""Winds that were measured at a height above the bed: `u at 1 m [m/s]`, `wind speed (10 m)`, `U10`.

Such a wind is neither a friction velocity nor the free stream of a tunnel. With the roughness length of the
bed it gives the friction velocity by the law of the wall.
"""

import re
from math import log, nan

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.headings import VOLUMETRIC, Heading, stated_number
from taichi_erosion.measures.boundary_layer import KARMAN
from taichi_erosion.scene.schema.units import parse_scale, parse_unit

WINDS = ("threshold_wind_speed", "conditions.wind_speed")
SYMBOL = re.compile(r"\s*[uUvV](?![\w*])|\s*[uUvV]_?\d")  # of a speed; u* is none
HEIGHT = re.compile(r"(?<![\w.,/^-])_?(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>mm|cm|m)(?![\w/^-])")
INDEX = re.compile(r"\s*[uUvV]_?(?P<number>\d+)\s*(?:m\b|$|[\s(\[])")  # U10, u_2
SPEED = parse_unit("m/s").kind
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def wind_height(heading: Heading, name: str) -> float:
    """Height above the bed at which a column of winds was measured [m]; NaN where it states none.

    `name` is what the heading means; a single letter u or v is a speed where its unit is one.
    """
    speed = heading.unit not in ("", VOLUMETRIC) and parse_scale(heading.unit).kind == SPEED
    if name not in WINDS and not (SYMBOL.match(heading.name) and speed):
        return nan
    text = re.sub(r"\[[^\]]*\]", " ", heading.text)
    found = HEIGHT.search(text.replace("_", " "))
    if found is not None:
        return float(found["number"].replace(",", ".")) * METRES[found["unit"]]
    index = INDEX.match(text)
    return nan if index is None else float(index["number"])


def friction_factor(height: float, roughness: float) -> float:
    """Friction velocity over the wind at a height [1], by the law of the wall over a rough bed.

        u* / U = kappa / ln(z / z0)

    with z the height [m] above the bed, z0 its roughness length [m] and kappa von Karman's constant [1].
    Holds in neutral air for z far above z0, within the lowest tenth of the boundary layer.

    Reference: Schlichting & Gersten (2017), Boundary-Layer Theory, section 17.1.2.
    """
    return KARMAN / log(height / roughness)


def roughness_length(text: str, height: float) -> float:
    """Roughness length [m] as the user states it, `0.03 mm`; raises BadInput."""
    value = stated_number(text, "m", "roughness length", "0.03 mm")
    if not 0.0 < value < 0.1 * height:
        told = f"must lie above 0 and below a tenth of the height of the wind, {height:g} m"
        raise BadInput(f"roughness length '{text}': {told}")
    return value
