"""Tables and models at the edge of what can be answered: a clear sentence, and no name without evidence."""

from collections.abc import Callable
from pathlib import Path

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.files import Command
from tests.evidence import small_study
from tests.evidence.asking import SILENT, ask
from tests.evidence.small_study import MODEL as SOUND
from tests.evidence.small_study import table_text

HEAD = "observable,value,sd,n,unit,group,moisture,diameter [mm],source\n"
ACTING = {"liquid_bridge": 1.0}
MODEL = """
import numpy as np
from taichi_erosion.evidence.models.reduced import predict as sound

def nowhere(observable, conditions, parameters, effects, seeds):
    return np.full((len(seeds), len(conditions["moisture"])), np.nan)

def partly(observable, conditions, parameters, effects, seeds):
    found = sound(observable, conditions, parameters, effects, seeds)
    return np.where(conditions["moisture"] > 0.025, np.nan, found)
"""
ASKED: list[Command] = ["compare", "discover", "adopt", "next"]


def study_text(model: str = SOUND) -> str:
    return small_study.study_text(("liquid_bridge", "gusts"), model)


BEFORE, AFTER = study_text().split("[parameters", 1)[0], study_text()[study_text().index("[candidates]") :]


def rows(count: int, sd: bool = True, below: str = "") -> str:
    """Angles and thresholds that grow with moisture."""
    found = [
        f"{name},{below}{start + step * k:.4g},{error if sd else ''},5,{unit},g{k},{0.002 * k},0.25,x"
        for name, start, step, error, unit in (
            ("threshold_u_star", 0.2, 0.03, 0.004, "m/s"),
            ("repose_angle", 28.0, 1.5, 0.5, "deg"),
        )
        for k in range(count)
    ]
    return HEAD + "\n".join(found) + "\n"


@pytest.fixture
def study(tmp_path: Path) -> Callable[..., Path]:
    """Function that writes a study with a table, or with that of a world in which an effect acts."""

    def written(table: str = "", text: str = "") -> Path:
        (tmp_path / "heap.csv").write_text(table or table_text(ACTING, 1), encoding="utf-8")
        (tmp_path / "lab.py").write_text(MODEL, encoding="utf-8")
        (tmp_path / "heap.toml").write_text(text or study_text(), encoding="utf-8")
        return tmp_path / "heap.toml"

    return written


def asked(command: Command, path: Path):
    return ask(command, path, *(ACTING if command == "adopt" else ()))


@pytest.mark.parametrize("command", ASKED)
def test_without_any_scatter_nothing_can_be_judged(study, command: Command):
    with pytest.raises(BadInput, match=r"heap.csv: no row has an sd, .* the scatter is unknown"):
        asked(command, study(rows(12, sd=False)))


def test_an_observable_without_scatter_is_left_out_with_a_word(study):
    lines = rows(12).splitlines()
    blind = [",".join([*line.split(",")[:2], "", *line.split(",")[3:]]) for line in lines]
    mixed = [b if line.startswith("repose") else line for line, b in zip(lines, blind, strict=True)]
    path = study("\n".join(mixed) + "\n")
    for command in ASKED:
        found = asked(command, path)
        assert set(found.record.rows.observable) == {"threshold_u_star"}
        assert any("repose_angle: the scatter of" in words for words in found.about["warnings"])


@pytest.mark.parametrize("command", ASKED)
def test_a_model_without_a_value_at_its_start_is_told(study, command: Command):
    with pytest.raises(BadInput, match="no value at any measured condition with the start values"):
        asked(command, study(text=study_text(model="lab:nowhere")))


def test_conditions_where_the_model_has_no_value_are_left_out(study):
    found = ask("discover", study(text=study_text(model="lab:partly")))
    assert found.record.decided.named == tuple(ACTING)
    assert found.record.rows.conditions["moisture"].max() < 0.025
    assert any("no value at 6 of 22 conditions" in words for words in found.about["warnings"])


def test_a_table_of_limits_alone_names_nothing(study):
    path = study(rows(10, below="<"))
    for command in ("compare", "discover", "next"):
        found = ask(command, path)
        assert found.record.decided.verdict in SILENT
    assert ask("compare", path).answer().lines[0].startswith("The calibrated model agrees")


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_rows_name_nothing_and_say_why(study, count: int):
    path = study(rows(count))
    found = ask("discover", path)
    assert found.record.decided.verdict == "not_testable"
    assert found.record.effects == {}
    assert found.about["set_up"][0].startswith("error: too few rows to tell effects apart")
    first, *_, last = found.answer().lines
    assert first == "No effect is named before the errors above are mended."
    assert last.startswith("Mend the errors")
    assert "before the errors above are mended" in ask("next", path).answer().lines[0]
    assert ask("adopt", path, "liquid_bridge").answer().lines[0].startswith("No held-out row tests")


def test_without_calibrated_numbers_the_effect_is_named_beside_the_levels_that_they_would_take(study):
    path = study(text=BEFORE + AFTER)
    found = ask("discover", path)
    assert found.record.decided.named == tuple(ACTING)
    assert found.record.numbers == {}
    assert found.record.fit.p_after > 0.01, "levels that are told are no misfit"
    assert "The error falls" in ask("adopt", path, "liquid_bridge").answer().lines[0]


def test_without_candidates_only_what_no_list_holds_is_left(study):
    text = study_text().split("[candidates]")[0] + "[vault]\nfraction = 0.3\n"
    assert ask("discover", study(text=text)).record.decided.verdict == "outside_library"
    found = ask("discover", study(table_text({}, 1), text))
    assert found.record.decided.verdict == "none_detected"
    assert found.record.decided.probabilities["none"] > 0.8
    assert ask("next", study(table_text({}, 1), text)).record.experiments == ()
    with pytest.raises(BadInput, match="liquid_bridge is no candidate; there are: none"):
        ask("adopt", study(text=text), "liquid_bridge")


@pytest.mark.parametrize(("runs", "words"), [(10, "10 runs is used up"), (1500, "every effect tried once")])
def test_a_budget_below_what_calibration_takes_is_refused(study, runs: int, words: str):
    path = study(text=f"{study_text()}[budget]\nruns = {runs}\n")
    with pytest.raises(BadInput, match=f"{words}.*[Rr]aise budget.runs"):
        ask("discover", path)


def test_an_angle_in_radians_blocks_the_answer(study):
    head, *lines = table_text({}, 1).splitlines()
    cells = [line.split(",") for line in lines]
    small = [[c[0], f"{float(c[1]) / 57.3:.6g}", *c[2:]] if c[0] == "repose_angle" else c for c in cells]
    path = study("\n".join([head, *map(",".join, small)]) + "\n")
    for command in ("discover", "next"):
        found = ask(command, path)
        assert "times what the calibrated model says" in found.about["set_up"][0]
        assert "check the unit of its column" in found.about["set_up"][0]
        assert found.record.decided.verdict == "not_testable"
    assert ask("discover", path).record.decided.named == ()
