"""Commands alone find what a laboratory hides in the closed-form model, and nothing where nothing is."""

import json

import pytest

from taichi_erosion.cli.main import main
from tests.evidence.small_study import DRY, MOIST, study_text, table_text

SEED = 20


def ask(capsys, *words: str) -> dict:
    capsys.readouterr()
    assert main([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def study(tmp_path):
    """Function that writes a study of a laboratory in whose world some effects act."""

    def written(truth: dict[str, float], grid=MOIST) -> str:
        (tmp_path / "heap.csv").write_text(table_text(truth, SEED, grid), encoding="utf-8")
        (tmp_path / "heap.toml").write_text(study_text(), encoding="utf-8")
        return str(tmp_path / "heap.toml")

    return written


def test_a_hidden_effect_is_found_named_and_adopted(study, capsys):
    hidden, strength = "dry_cohesion", 1.3
    path = study({hidden: strength}, DRY)
    compared = ask(capsys, "compare", path)
    assert compared["p"] < 0.01
    assert "diameter" in {place["axis"] for place in compared["where"] if place["p"] < 0.05}

    found = ask(capsys, "discover", path)
    assert found["verdict"] in ("present", "group")
    assert (found["named"] or found["group"]) == [hidden]

    adopted = ask(capsys, "adopt", path, hidden)
    vault = adopted["vault"]
    assert vault["chi2_after"] < 0.5 * vault["chi2_before"]
    # a wrong effect with a free strength may gain a little by chance, not half of the error
    assert vault["chi2_wrong_effect"] > 0.5 * vault["chi2_before"]
    fitted = adopted["added"]["strengths"][hidden]
    # the 90 % interval misses one time in ten; three times its half-width misses once in a million
    half = 0.5 * (fitted["high"] - fitted["low"])
    assert abs(fitted["value"] - strength) < 3.0 * half
    # three repeats at sixteen settings fix a strength of 1.4 to 0.09; an interval that holds anything is none
    assert half < 0.15


def test_a_null_stays_a_null(study, capsys):
    path = study({})
    assert ask(capsys, "compare", path)["p"] > 0.01
    found = ask(capsys, "discover", path)
    assert found["verdict"] in ("none_detected", "not_testable")
    assert found["named"] == []
