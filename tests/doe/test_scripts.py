"""Every script of a study can be imported from the repository root, and says how it is used."""

from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "doe").rglob("*.py"))
    if path.name != "my_lab.py"  # a model of a study, loaded by its path
]


@pytest.mark.parametrize("name", MODULES)
def test_a_module_is_imported_by_its_name(name: str):
    module = import_module(name)
    if '__name__ == "__main__"' in Path(str(module.__file__)).read_text(encoding="utf-8"):
        assert f"python -m {name}" in (module.__doc__ or "")
