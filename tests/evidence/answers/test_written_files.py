"""A table that is corrected after its study was made: what changed is told; vault and edits stay."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.commands import open_study
from taichi_erosion.evidence.answers.new_study import NewStudyOptions, write_new_study
from taichi_erosion.evidence.data.held_out_rows import count_opening
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.tables.spreadsheet import laboratory_table_digest

HEAD = "Sample;diameter [um];moisture [%];threshold friction velocity [cm/s];SD;n\n"
WISHES = NewStudyOptions(closed_form=True)


def line(name: str, diameter: float, moisture: float, factor: float = 1.0) -> str:
    bare = 0.1 * math.sqrt(2650.0 / 1.2 * 9.81 * diameter * 1e-6)  # Bagnold's law [m/s]
    value = 100.0 * bare * math.sqrt(1.0 + 0.5 * moisture) * factor
    return f"{name};{diameter:g};{moisture:g};{value:.2f};0.6;5\n"


LINES = [line(f"S{d}-{m}", d, m) for d in (100, 160, 250, 400, 630, 800) for m in (0, 0.4, 0.8, 1.2)]


def written(folder: Path, lines: list[str], head: str = HEAD) -> Path:
    table = folder / "sand.csv"
    table.write_text(head + "".join(lines), encoding="utf-8")
    return table


def again(folder: Path, lines: list[str], head: str = HEAD) -> dict:
    return write_new_study(written(folder, lines, head), WISHES, lambda _, guess: guess)


def files_of(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in (folder / "sand").iterdir()}


def held_out(folder: Path) -> set[tuple[float, float]]:
    """Diameters [um] and moistures [%] of the vault."""
    at = load_study(folder / "sand" / "sand.toml").problem.measurements_in_vault().conditions
    return set(zip((1e6 * at["diameter"]).round(3), (100.0 * at["moisture"]).round(3), strict=True))


def without_digest(text: str) -> list[str]:
    """Lines of a study without the digest of the table that it was made from."""
    return [each for each in text.splitlines() if "made_from_digest" not in each]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    again(tmp_path, LINES)
    return tmp_path


def test_a_corrected_value_is_told_and_moves_no_row_into_or_out_of_the_vault(folder):
    before, digest = held_out(folder), load_study(folder / "sand" / "sand.toml").digest
    for place in (0, 18):
        lines = list(LINES)
        lines[place] = lines[place].rpartition(";0.6;")[0].rpartition(";")[0] + ";77.7;0.6;5\n"
        assert place + 2 in again(folder, lines)["changes"]["lines"]
        assert held_out(folder) == before
        study = load_study(folder / "sand" / "sand.toml")
        assert study.vault_digest == digest != study.digest


def test_a_corrected_condition_moves_no_other_row_and_its_own_stays_what_it_was(folder):
    before = held_out(folder)
    diameter, moisture = min(before)
    name, old = f"S{diameter:.0f}-{moisture:g}", f";{diameter:.0f};"
    again(folder, [text.replace(old, ";333;", 1) if text.startswith(name) else text for text in LINES])
    assert held_out(folder) == before - {(diameter, moisture)} | {(333.0, moisture)}


def test_rows_that_are_added_leave_the_others_what_they_were(folder):
    before = held_out(folder)
    added = ((120, 0), (300, 0.2), (300, 1.0), (500, 0.6), (700, 0.2), (900, 1.4))
    new = [line(f"T{d}-{m}", d, m) for d, m in added]
    found = again(folder, [*LINES[:9], *new[:3], *LINES[9:], *new[3:]])
    assert found["changes"] == {"lines": [11, 12, 13, 29, 30, 31], "removed": 0}
    assert held_out(folder) == before, "what is measured later, on request, is fitted"


def test_rows_that_show_more_effects_add_candidates_and_a_column_of_samples_moves_none(tmp_path):
    study, head = tmp_path / "sand" / "sand.toml", HEAD.partition(";")[2]
    again(tmp_path, LINES[:4])
    assert "dry_cohesion" not in load_study(study).problem.candidate_names
    again(tmp_path, [each.partition(";")[2] for each in LINES], head)
    assert "dry_cohesion" in load_study(study).problem.candidate_names
    before = held_out(tmp_path)
    again(tmp_path, [*LINES, line("T", 300, 1)])
    assert held_out(tmp_path) == before


def test_the_count_of_openings_goes_on(folder, capsys):
    study = folder / "sand" / "sand.toml"
    problem = load_study(study)
    assert count_opening(problem.results, problem.digest, "liquid_bridge") == 1
    lines = list(LINES)
    lines[3] = lines[3].replace(";0.6;5", ";0.7;5")
    again(folder, lines)
    assert load_study(study).problem.vault.opened == 1
    assert main(["adopt", str(study), "liquid_bridge", "--budget", "quick", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["vault"]["opened"] == 2


def test_what_the_user_changed_in_the_study_stays_unless_it_is_written_anew(folder):
    study = folder / "sand" / "sand.toml"
    mine = study.read_text("utf-8").replace("prior_sd_log = 0.2", "prior_sd_log = 0.4    # my own")
    study.write_text(mine, encoding="utf-8")
    found = again(folder, [*LINES, line("T", 300, 0.2)])
    assert without_digest(study.read_text("utf-8")) == without_digest(mine)
    assert load_study(study).file.study.made_from_digest == laboratory_table_digest(folder / "sand.csv")
    assert found["written"] == [str(study), str(folder / "sand" / "sand_tidy.csv")]
    before = held_out(folder)
    write_new_study(folder / "sand.csv", replace(WISHES, anew=True), lambda _, guess: guess)
    assert "my own" not in study.read_text("utf-8")
    assert held_out(folder) == before


def test_a_table_that_has_not_changed_leaves_all_files_as_they_are(folder, capsys):
    files = files_of(folder)
    assert main(["study", "new", str(written(folder, LINES)), "--yes", "--closed-form"]) == 0
    assert "new or corrected rows: none; 0 gone" in capsys.readouterr().out
    assert files_of(folder) == files


def test_a_spreadsheet_that_changed_after_the_study_is_told_until_it_is_read_again(folder, capsys):
    said = "sand.csv has changed since `study new`: run it again to take over the changes"
    study = folder / "sand" / "sand.toml"

    def told() -> tuple[bool, bool, bool]:
        """Whether the check, a command of the loop, and what all of them open say so, once each."""
        found = []
        for words in (["study", "check"], ["compare"]):
            assert main([*words, str(study)]) == 0
            found.append(" ".join(capsys.readouterr().out.split()).count(said) == 1)
        with open_study(study) as opened:
            return *found, [fault.kind for fault in opened.faults] == ["source_changed"]

    table = written(folder, [LINES[0].replace(";0.6;5", ";0.7;5"), *LINES[1:]])
    assert told() == (True, True, True)
    assert main(["study", "new", str(table), "--yes", "--closed-form"]) == 0
    assert told() == (False, False, False)


def test_a_table_of_another_file_and_one_that_the_study_does_not_fit_are_refused(folder):
    files = files_of(folder)
    (folder / "other").mkdir()
    table = written(folder / "other", LINES)
    with pytest.raises(BadInput, match=r"is a study of another table; .*--out"):
        write_new_study(table, replace(WISHES, folder=folder / "sand"), lambda _, guess: guess)
    with pytest.raises(BadInput, match=r"conditions\.moisture is not in sand_tidy"):
        again(folder, LINES, HEAD.replace(";moisture [%]", ";note"))
    assert files_of(folder) == files


@pytest.mark.parametrize("name", ["heap.toml", "cylinder.toml"])
def test_a_study_or_scene_of_anothers_is_not_written_over(tmp_path, name):
    heaps = "Sample;diameter [mm];repose angle [deg];SD;n\nA;1;31;0.7;5\nB;2;32;0.7;5\nC;3;33;0.7;5\n"
    (tmp_path / "heap.csv").write_text(heaps, encoding="utf-8")
    there = tmp_path / "both" / name
    there.parent.mkdir()
    there.write_text("another's", encoding="utf-8")
    with pytest.raises(BadInput, match=rf"{name}: exists; .*--out"):
        write_new_study(tmp_path / "heap.csv", NewStudyOptions(folder=there.parent), lambda _, guess: guess)
    assert {path.name: path.read_text("utf-8") for path in there.parent.iterdir()} == {name: "another's"}
