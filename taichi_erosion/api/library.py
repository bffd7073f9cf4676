"""Effects of the library as a table."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_erosion.api.notebook import frame
from taichi_erosion.api.wording import in_python

if TYPE_CHECKING:
    import pandas as pd


@in_python
def effects(effect_files: Sequence[str | Path] = ()) -> "pd.DataFrame":
    """All effects, those of own files too: name, title, place, conditions, largest strength [1]."""
    from taichi_erosion.effects import load_library

    library = load_library([Path(file) for file in effect_files])
    rows = (
        {
            "effect": name,
            "title": effect.title,
            "place": effect.place,
            "reads": ", ".join(effect.reads),
            "largest_strength": effect.most,
        }
        for name, effect in sorted(library.items())
    )
    return frame(rows, {"largest_strength": "1"}).set_index("effect")
