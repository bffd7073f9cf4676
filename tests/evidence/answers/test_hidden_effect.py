"""Commands alone find what a laboratory hides in the closed-form model, and nothing where nothing is."""

from pathlib import Path

import pytest

from tests.evidence.asking import ask
from tests.evidence.small_study import DRY, MOIST, study_text, table_text

SEED = 20


@pytest.fixture
def study(tmp_path: Path):
    """Function that writes a study of a laboratory in whose world some effects act."""

    def written(truth: dict[str, float], grid=MOIST) -> Path:
        (tmp_path / "heap.csv").write_text(table_text(truth, SEED, grid), encoding="utf-8")
        (tmp_path / "heap.toml").write_text(study_text(), encoding="utf-8")
        return tmp_path / "heap.toml"

    return written


def test_a_hidden_effect_is_found_named_and_adopted(study):
    hidden, strength = "dry_cohesion", 1.3
    path = study({hidden: strength}, DRY)
    compared = ask("compare", path).record
    assert compared.fit.p_before < 0.01
    assert "diameter" in {place.axis for place in compared.where if place.p < 0.05}

    found = ask("discover", path).record
    assert found.decided.verdict in ("present", "group")
    assert (found.decided.named or found.decided.group) == (hidden,)

    adopted = ask("adopt", path, hidden).record
    held = adopted.held_out
    assert held.after < 0.5 * held.before
    assert held.wrong > 5.0 * held.after, "a wrong effect that falls with diameter too gains some"
    fitted = adopted.effects[hidden].strength
    # the 90 % interval misses one time in ten; three times its half-width misses once in a million
    half = 0.5 * (fitted.high - fitted.low)
    assert abs(fitted.value - strength) < 3.0 * half
    # three repeats at sixteen settings fix a strength of 1.4 to 0.09; an interval that holds anything is none
    assert half < 0.15


def test_a_null_stays_a_null(study):
    path = study({})
    assert ask("compare", path).record.fit.p_before > 0.01
    found = ask("discover", path).record
    assert found.decided.verdict == "none_detected"
    assert found.decided.named == ()
