"""The library of optional physics: one file an effect, found by looking into this folder.

Others may add effects from outside: as an installed entry point of the group `taichi_erosion.effects`, or
as a file that a scene, a study or the command line names. A file is executed only when it is named.
"""

import inspect
import re
import sys
from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from hashlib import sha256
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from pkgutil import iter_modules

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.effect_file import (
    DIGITS,
    MEMBER,
    EffectFile,
    effect_in,
    error_text,
    read_effect_file,
    require_effect,
)
from taichi_erosion.core.errors import BadInput

GROUP = "taichi_erosion.effects"  # of entry points
TITLE = re.compile(r'\beffect_of\(\s*__name__,\s*"(.+?)",')  # in the file of an effect


def load_library(files: Iterable[Path | EffectFile] = ()) -> dict[str, Effect]:
    """Effects by name: those of this folder, of installed packages, and of the files named.

    Raises BadInput where a file holds no effect or two effects share a name.
    """
    library = dict(installed_effects(tuple(sys.path)))
    for file in dict.fromkeys(files):
        add(library, effect_in(file if isinstance(file, EffectFile) else read_effect_file(file)), str(file))
    return dict(sorted(library.items()))


def effect_titles(files: Iterable[Path] = ()) -> dict[str, str]:
    """Titles of the library by name. Those of this folder are in its text, which needs no compiler."""
    if (files := tuple(files)) or entry_points(group=GROUP):
        return {name: effect.title for name, effect in load_library(files).items()}
    texts = {name: Path(__path__[0], f"{name}.py").read_text(encoding="utf-8") for name in shipped_effects()}
    return {name: title[1] for name, text in texts.items() if (title := TITLE.search(text))}


@lru_cache(maxsize=4)
def installed_effects(_search_path: tuple[str, ...]) -> Mapping[str, Effect]:
    """Effects of this folder and of installed packages. Raises BadInput."""
    library: dict[str, Effect] = {}
    for name in shipped_effects():
        add(library, getattr(import_module(f"{__name__}.{name}"), MEMBER), name)
    for point in entry_points(group=GROUP):  # its value is a module, or the record in it
        entry = f"entry point {point.name} = {point.value}"
        try:
            loaded = point.load()
        except Exception as error:
            message = " ".join(error_text(error).split())
            raise BadInput(f"{entry} of an installed package: {message}") from None
        effect = loaded if isinstance(loaded, Effect) else getattr(loaded, MEMBER, None)
        add(library, require_effect(effect, f"{entry} of an installed package"), f"the package's {entry}")
    return library


def add(library: dict[str, Effect], effect: Effect, origin: str) -> None:
    """Put an effect into a library. Raises BadInput where its name is taken."""
    if effect.name in library:
        kind = "the library" if effect.name in shipped_effects() else "another file or package"
        message = f"effect '{effect.name}' exists already in {kind}"
        raise BadInput(f"{origin}: {message}; give it a name of its own in {MEMBER} = Effect(name=...)")
    library[effect.name] = effect


def package_digests(names: Iterable[str]) -> dict[str, str]:
    """Digests of the source of those effects that come from installed packages."""
    packages, library = set(shipped_effects()), installed_effects(tuple(sys.path))
    foreign = [name for name in names if name in library and name not in packages]
    files = {name: Path(inspect.getfile(inspect.unwrap(library[name].act))) for name in foreign}
    return {name: sha256(file.read_bytes()).hexdigest()[:DIGITS] for name, file in files.items()}


@cache
def shipped_effects() -> tuple[str, ...]:
    """Names of the files of this folder."""
    return tuple(sorted(module.name for module in iter_modules(__path__)))
