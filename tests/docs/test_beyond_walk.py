"""The walk of docs/beyond_the_list.md: from a table that no listed effect explains to an adopted law."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence.answers.files import read_answer
from taichi_erosion.report import write_report
from tests.report.browser import assert_readable

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "beyond_the_list.md").read_text(encoding="utf-8")
EXPONENT = 0.7  # of the laboratory
pytestmark = [pytest.mark.docs, pytest.mark.slow]


def test_a_table_beyond_the_list_leads_to_a_law_and_a_falling_error(tmp_path, monkeypatch):
    folder = tmp_path / "doe" / "beyond"
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "doe" / "beyond" / "rolling_wet.toml", folder)
    words = [sys.executable, "-m", "doe.beyond.laboratory", str(folder / "rolling_wet.csv")]
    subprocess.run(words, cwd=ROOT, check=True, timeout=600.0)
    monkeypatch.chdir(tmp_path)
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL):
        for line in block.splitlines():
            assert main(shlex.split(line.removeprefix("./erosion "))) == 0, line
    results = folder / "rolling_wet-results"
    discovered, adopted = (read_answer(results, "rolling_wet", command) for command in ("discover", "adopt"))
    assert discovered is not None
    beyond = discovered["beyond"]
    assert (beyond["verdict"], beyond["group"]) == ("mechanism", ["rolling_friction"])
    exponent = beyond["law"]["exponents"]["moisture"]
    assert exponent["low"] < EXPONENT < exponent["high"]
    assert adopted is not None
    assert adopted["vault"]["chi2_after"] < 0.1 * adopted["vault"]["chi2_before"]
    assert adopted["vault"]["chi2_wrong_effect"] > 2.0 * adopted["vault"]["chi2_after"]
    page = write_report(Path("doe/beyond/rolling_wet.toml"), tmp_path / "page.html")
    assert_readable({"page": page}, tmp_path)
    assert 'id="beyond"' in page.read_text(encoding="utf-8")


def test_the_committed_table_is_the_one_of_the_laboratory():
    from doe.beyond.laboratory import table

    assert (ROOT / "doe" / "beyond" / "rolling_wet.csv").read_text(encoding="utf-8") == table()
