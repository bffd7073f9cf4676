"""Tables and models at the edge of what can be answered: a clear sentence, and no name without evidence."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.commands import open_study
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


def rows(count: int, sd: bool = True, below: str = "") -> str:
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
def test_without_any_scatter_or_value_of_the_model_nothing_can_be_judged(study, command: Command):
    with pytest.raises(BadInput, match=r"heap.csv: no row has an sd, .* the scatter is unknown"):
        asked(command, study(rows(12, sd=False)))
    with pytest.raises(BadInput, match="no value at any measured condition with the start values"):
        asked(command, study(text=study_text(model="lab:nowhere")))


def test_an_observable_without_scatter_is_left_out_with_a_word(study):
    blind = [line for line in rows(12, sd=False).splitlines() if line.startswith("repose")]
    known = [line for line in rows(12).splitlines() if not line.startswith("repose")]
    path = study("\n".join([*known, *blind]) + "\n")
    for command in ASKED:
        found = asked(command, path)
        assert set(found.record.rows.observable) == {"threshold_u_star"}
        assert any("repose_angle: the scatter of" in words for words in found.about["warnings"])


def test_conditions_where_the_model_has_no_value_are_left_out(study):
    found = ask("discover", study(text=study_text(model="lab:partly")))
    assert found.record.named == tuple(ACTING)
    assert found.record.rows.conditions["moisture"].max() < 0.025
    assert any("no value at 6 of 22 conditions" in words for words in found.about["warnings"])


def test_a_table_of_limits_alone_names_nothing(study):
    path = study(rows(10, below="<"))
    for command in ("compare", "discover", "next"):
        assert ask(command, path).record.verdict in SILENT
    assert ask("compare", path).answer().lines[0].startswith("The calibrated model agrees")


@pytest.mark.parametrize(("count", "soils", "enough"), [(5, 4, 0), (6, 4, 1), (6, 2, 0), (6, 1, 1)])
def test_rows_are_enough_where_one_is_left_to_contradict_an_effect(study, count, soils, enough):
    table = "".join(rows(4).splitlines(keepends=True)[: 1 + count])  # three numbers, an effect, a level
    table = table.replace("g2", "g0").replace("g3", "g1") if soils == 2 else table  # of two soils one more
    one = re.sub("g[0-3]", "g0", table)  # of two soils under all conditions
    table = one + one.removeprefix(HEAD).replace("g0", "g1") if soils == 1 else table
    with open_study(study(table, study_text().replace("fraction = 0.3", "fraction = 0"))) as found:
        assert ("too_few_rows" in [fault.kind for fault in found.faults]) is not bool(enough)


def test_what_is_left_of_a_prior_counts_on_its_own_scale(study):
    far = study_text().replace("start = 0.1, low = 0.05", "start = 0.02, low = 0.005", 1)
    found = ask("compare", study(rows(6).replace(",0.004,", ",0.5,"), far)).record
    assert abs(found.parameters["threshold_coefficient"].prior_share - 1.0) < 3.0 * 0.02, "2,000 draws"


def test_too_few_rows_name_nothing_and_say_why(study):
    path = study(rows(1))
    found = ask("discover", path)
    assert (found.record.verdict, found.record.effects) == ("not_testable", {})
    assert "6 are needed to calibrate threshold coefficient, sliding fr" in found.about["set_up"][0]
    assert found.answer().lines[0] == "No effect is named before the errors above are fixed."
    assert ask("compare", path).answer().lines[-1].startswith("Fix the errors above and run")
    assert "before the errors above are fixed" in ask("next", path).answer().lines[0]
    assert ask("adopt", path, "liquid_bridge").answer().lines[0].startswith("No held-out row tests")


@pytest.mark.parametrize("factor", [1.0, 3.0, 12.0])
def test_repeats_that_differ_more_than_stated_are_told(study, factor):
    lines = [
        f"threshold_u_star,{value:.5f},0.004,1,m/s,g{k // 4},{0.002 * (k // 4)},0.25,x"
        for k, value in enumerate(0.3 + 0.004 * factor * np.random.default_rng(3).standard_normal(24))
    ]
    text = study_text().replace("[observables.repose_angle]\n", "")
    with open_study(study(HEAD + "\n".join(lines), text)) as found:
        told = [fault.blocks for fault in found.faults if fault.kind == "scatter"]
    assert told == [False] * (factor > 1.0)


def test_rows_that_are_pasted_twice_tell_no_scatter(study):
    table = table_text({}, 1, repeats=1).replace("value,n", "value,sd,n").replace(",1,deg", ",0.5,1,deg")
    table = table.replace(",1,m/s", ",0.006,1,m/s")
    found = ask("compare", study(table + table.partition("\n")[2])).record
    assert (found.p_misfit > 0.05, *(np.isnan(each.factor) for each in found.scatter)) == (True,) * 3


def test_values_that_rounding_makes_equal_show_no_law(study):
    at = [(w, d) for d in (0.15, 0.25, 0.4, 0.6, 0.9) for w in (0.0, 0.005, 0.01, 0.02)]
    rounded = (f"threshold_u_star,{0.41 * d**0.5:.1f},0.02,5,m/s,g{w}{d},{w},{d},x" for w, d in at)
    text = study_text().replace("[observables.repose_angle]\n", "")
    assert ask("discover", study(HEAD + "\n".join(rounded), text)).record.verdict in SILENT


def test_a_typo_in_a_repeat_is_told_and_the_same_effect_is_named(study):
    head, *lines = table_text(ACTING, 1).splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith("repose_angle"))
    name, value, *rest = lines[row].split(",")
    lines[row] = ",".join([name, f"{float(value) + 30.0:.6g}", *rest])
    found = ask("discover", study("\n".join([head, *lines]) + "\n"))
    assert found.about["set_up"][0].endswith(f"check row {row + 2}")
    assert "Correct or confirm the repeats" in found.answer().lines[-1]
    assert found.record.named == tuple(ACTING)
    assert [row + 2 in each.rows for each in found.record.repeats] == [True]


def test_a_mistyped_repeat_is_told_first_with_its_row_in_the_users_table(tmp_path, capsys):
    """Angles of a laboratory that measured every heap twice; one cell says 60 for 30."""
    random = np.random.default_rng(2)
    places = [(d, w) for d in (0.2, 0.4, 0.8) for w in (0.0, 0.5, 1.0, 2.0) for _ in range(2)]
    rows = [f"{d};{w};{28.0 + 3.0 * w + 2.0 * d + 0.4 * random.standard_normal():.1f}" for d, w in places]
    rows[12] = "0.4;1.0;60.0"
    table, study = tmp_path / "lab.csv", tmp_path / "s" / "lab.toml"
    table.write_text("\n".join(["diameter [mm];moisture [%];repose angle [deg]", *rows, ""]), "utf-8")
    new = ["new", str(table), "--closed-form", "--yes", "--out", str(study.parent)]
    for words in (new, ["check", str(study)]):
        assert main(["study", *words, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)["notes"][0]
        assert "rows 14 and 15 differ by" in told
        assert told.endswith("check row 14")
    compared = ask("compare", study)
    assert compared.about["set_up"][0] == f"warning: {told}"
    assert not [error for error in compared.record.errors if error.kind == "scatter"]


@pytest.mark.parametrize(("salt", "trends"), [(0.0, {"moisture"}), (1.5, {"moisture", "salinity"})])
def test_one_condition_does_not_show_the_trend_of_another(tmp_path, salt, trends):
    """Wetter heaps are saltier, and angles rise as the root of moisture; salt acts in one table of two."""
    random = np.random.default_rng(3)
    moisture = np.repeat([0.0, 0.2, 0.5, 1.0, 2.0, 4.0], 6)
    salinity = np.round(2.0 + 2.0 * moisture + np.repeat(random.uniform(0.0, 4.0, 18), 2), 2)
    angle = 28.0 + 4.0 * np.sqrt(moisture) + salt * salinity + 0.3 * random.standard_normal(moisture.size)
    rows = [f"{w},{s:.2f},{y:.2f}" for w, s, y in zip(moisture, salinity, angle, strict=True)]
    head = "moisture [%],salinity [g/kg],repose angle [deg]"
    (tmp_path / "lab.csv").write_text("\n".join([head, *rows, ""]), "utf-8")
    words = ["--closed-form", "--yes", "--diameter", "0.3mm", "--sd", "repose angle=0.3 deg"]
    assert main(["study", "new", str(tmp_path / "lab.csv"), *words, "--out", str(tmp_path / "s")]) == 0
    places = ask("compare", tmp_path / "s" / "lab.toml").record.where
    assert {place.axis for place in places if place.p < 0.01} == trends


def test_without_candidates_only_what_no_list_holds_is_left(study):
    text = study_text().split("[candidates]")[0] + "[vault]\nfraction = 0.3\n"
    assert ask("discover", study(text=text)).record.verdict == "outside_library"
    found = ask("discover", study(table_text({}, 1), text))
    assert found.record.verdict == "none_detected"
    assert found.record.probabilities["none"] > 0.8
    assert ask("next", study(table_text({}, 1), text)).record.next_experiments == ()
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
        assert found.about["set_up"][0].endswith("check the unit of its column")
        assert (found.record.verdict, found.record.named) == ("not_testable", ())
