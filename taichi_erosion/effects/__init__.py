"""The library of optional physics: one file an effect, found by looking into this folder.

Others may add effects from outside: as an installed entry point of the group `taichi_erosion.effects`, or
as a file named on the command line. A file is executed only when it is named.
"""

from collections.abc import Iterable
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput

GROUP = "taichi_erosion.effects"  # of entry points
MEMBER = "EFFECT"  # name of the record in an effect's file


def load_library(files: Iterable[Path] = ()) -> dict[str, Effect]:
    """Effects by name: those of this folder, of installed packages, and of the files named.

    Raises BadInput where a file holds no effect or two effects share a name.
    """
    modules = [(name, import_module(f"{__name__}.{name}")) for name in shipped()]
    modules += [(point.value, point.load()) for point in entry_points(group=GROUP)]
    modules += [(str(path), module_of(path)) for path in files]
    library: dict[str, Effect] = {}
    for origin, module in modules:
        effect = module if isinstance(module, Effect) else getattr(module, MEMBER, None)
        if not isinstance(effect, Effect):
            raise BadInput(f"{origin}: holds no {MEMBER} = Effect(...)")
        if effect.name in library:
            raise BadInput(f"{origin}: effect '{effect.name}' exists already")
        library[effect.name] = effect
    return dict(sorted(library.items()))


def shipped() -> list[str]:
    """Names of the files of this folder."""
    return sorted(module.name for module in iter_modules(__path__))


def module_of(path: Path) -> Any:
    """Module of a Python file that the user named."""
    spec = spec_from_file_location(f"effect_{path.stem}", path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise BadInput(f"{path}: no such Python file")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise BadInput(f"{path}: cannot be loaded: {type(error).__name__}: {error}") from None
    return module
