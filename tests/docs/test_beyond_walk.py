"""The walk of docs/beyond_the_list.md: from a table that no listed effect explains to an adopted law."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence.answers.files import read_reply
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
    discovered = read_reply(results, "rolling_wet", "discover")
    adopted = read_reply(results, "rolling_wet", "adopt")
    assert discovered is not None
    assert adopted is not None
    told = discovered.answer().lines
    shown = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)[0].splitlines()
    assert all(any(line.startswith(each) for line in told) for each in shown)
    assert discovered.record.decided.mechanisms == ("rolling_friction",)
    law, held = discovered.record.law, adopted.record.held_out
    assert law is not None
    assert held is not None
    assert law.exponents["moisture"].low < EXPONENT < law.exponents["moisture"].high
    assert held.after < 0.1 * held.before
    assert held.wrong > 2.0 * held.after
    page = write_report(Path("doe/beyond/rolling_wet.toml"), tmp_path / "page.html")
    assert_readable({"page": page}, tmp_path)


def test_the_committed_table_is_the_one_of_the_laboratory():
    from doe.beyond.laboratory import table

    assert (ROOT / "doe" / "beyond" / "rolling_wet.csv").read_text(encoding="utf-8") == table()
