"""Beds of other runs as fills: grains of a checkpoint, and their contacts, where they were."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.checkpoint_file import Arrays, load_checkpoint
from taichi_erosion.scene.schema.fields import resolve
from taichi_erosion.scene.schema.grains import Bed
from taichi_erosion.scene.schema.scene import Scene


@lru_cache(maxsize=1)
def read_bed(path: Path, _written: float) -> tuple[Arrays, dict[str, Any]]:
    """State and meta of a checkpoint, kept until the file is written again."""
    return load_checkpoint(path)


def saved_bed(scene: Scene, fill: Bed, seed: int) -> Arrays:
    """Grains and contacts of one replica of a checkpoint by rank; `kind` is a place in `Grains.parts`.

    The replica has the same place as that of the seed; fewer of them serve in turn. Raises BadInput.
    """
    path = scene.folder / fill.file
    state, meta = read_bed(path, path.stat().st_mtime if path.is_file() else 0.0)
    before: dict[str, Any] = meta.get("scene", {"grains": {}})
    wind, patch = before.get("wind"), before.get("domain", {}).get("period")
    patch = [wind["length"], wind["width"]] if wind else patch
    if before["grains"] != resolve(scene)["grains"] or patch != (scene.patch_size and [*scene.patch_size]):
        raise BadInput(f"fill.file = '{fill.file}': [grains] or periods differ from those of the checkpoint")
    if scene.grains.clump is not None:
        raise BadInput(f"fill.file = '{fill.file}': a bed consists of spheres; grains.clump must be left out")
    prefix = f"replica{(seed - scene.run.seed) % len(meta['replicas'])}_"
    bed = {name.removeprefix(prefix): values for name, values in state.items() if name.startswith(prefix)}
    kinds = list(scene.grains.parts)
    names = sorted({*kinds, *(wall["material"] for wall in before["geometry"].values())})
    places = np.array([kinds.index(name) if name in kinds else -1 for name in names])
    return bed | {"kind": places[bed["material"].astype(int)], "position": bed["origin"] + bed["shift"]}
