"""Matplotlib figures as SVG elements of a page: colours by role, for a dark page too, and texts to hover.

An artist whose `gid` is `layer:NAME` becomes an element with `data-layer="NAME"`, which a page can switch
off. One whose `gid` is `rows:NAME` is a layer too, and its markers get the texts of the figure, in order.
"""

import io
import re
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

from matplotlib.figure import Figure

SVG, LINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
# colour of a figure -> variable of the page's style sheet
ROLES = {
    "#1c2227": "--ink",
    "#fdfefe": "--paper",
    "#5b6670": "--soft",
    "#d9dde1": "--line",
    "#b4553d": "--before",
    "#1f4e79": "--after",
    "#8a93a0": "--control",
    "#4c8a6a": "--other",
}
LARGEST_SCALE = 1.65  # px of the page over points of the figure
FONT = re.compile(r"font(-family)?: ?[^;\"]*DejaVu[^;\"]*")
SIZE = re.compile(r"(\d+(?:\.\d+)?)px")
REFERENCE = re.compile(r"url\(#([^)]+)\)")


def inline_svg(figure: Figure, name: str, texts: Mapping[str, Sequence[str]]) -> str:
    """Figure as an SVG element; `name` keeps its identifiers apart from those of other figures."""
    page = io.BytesIO()
    figure.savefig(page, format="svg", transparent=True, metadata={"Date": None})
    ET.register_namespace("", SVG)
    ET.register_namespace("xlink", LINK)
    root = ET.fromstring(page.getvalue())
    for key in ("width", "height"):
        del root.attrib[key]
    for child in [one for one in root if one.tag.endswith("metadata")]:
        root.remove(child)
    for style in [
        one for one in root if one.tag.endswith("defs") and one.find(f"{{{SVG}}}style") is not None
    ]:
        root.remove(style)
    for element in root.iter():
        rename(element, name)
        recolour(element)
    for group in list(root.iter(f"{{{SVG}}}g")):
        mark(group, texts)
    root.set("role", "img")
    root.set("style", f"max-width: {LARGEST_SCALE * 72.0 * figure.get_figwidth():.0f}px")
    return ET.tostring(root, encoding="unicode")


def rename(element: ET.Element, name: str) -> None:
    """Give an element an identifier that is unique in the page, and so the references to it."""
    identifier = element.get("id")
    if identifier is not None and ":" not in identifier:
        element.set("id", f"{name}-{identifier}")
    link = element.get(f"{{{LINK}}}href")
    if link is not None and link.startswith("#"):
        element.set(f"{{{LINK}}}href", f"#{name}-{link[1:]}")
    for key in ("clip-path", "style"):
        value = element.get(key)
        if value is not None:
            element.set(key, REFERENCE.sub(rf"url(#{name}-\1)", value))


def recolour(element: ET.Element) -> None:
    """Colours of a role, and the font of the page, in place of fixed ones."""
    style = element.get("style")
    if style is None:
        return
    for colour, role in ROLES.items():
        style = style.replace(colour, f"var({role})")
    if element.tag.endswith("text") or element.tag.endswith("tspan"):
        style = FONT.sub(page_font, style)
        style = style if "fill" in style else f"{style}; fill: var(--ink)"
    element.set("style", style)


def page_font(found: re.Match[str]) -> str:
    """Font of the page in the size of the figure."""
    size = SIZE.search(found[0])
    return f"font: {size[0]} system-ui, sans-serif" if size else "font-family: system-ui, sans-serif"


def mark(group: ET.Element, texts: Mapping[str, Sequence[str]]) -> None:
    """Turn the `gid` of an artist into a layer, and give its points their texts."""
    kind, _, layer = (group.get("id") or "").partition(":")
    if not layer:
        return
    del group.attrib["id"]
    group.set("data-layer", layer.partition("#")[0])
    if kind != "rows":
        return
    points = list(group.iter(f"{{{SVG}}}use"))
    for point, text in zip(points, texts.get(layer, ()), strict=False):
        point.set("class", "row")
        title = ET.SubElement(point, f"{{{SVG}}}title")
        title.text = text
