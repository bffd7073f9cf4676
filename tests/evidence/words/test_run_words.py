"""A run in words: the difference from the measured value, warnings told once."""

import pytest

from taichi_erosion.evidence.words.run_words import measured_value_texts, run_table, run_warnings, step_texts


def run_document(value: float, n: int = 3, **more) -> dict:
    found = {"value": value, "sd": 0.5, "unit": "deg", "n": n, **more}
    return {
        "measures": {"repose_angle": found, "cone_angle": found},
        "measured": {"repose_angle": {"value": 33.5, "sd": 0.7, "n": 10}},
        "replicas": [{"seed": seed, "warnings": ["flank not straight"]} for seed in range(n)],
    }


@pytest.mark.parametrize(
    ("value", "n", "words"),
    [
        (28.7, 3, "4.8 deg lower than measured: 13.2 standard errors."),
        (38.5, 3, "5 deg higher than measured"),
        (33.6, 3, "agrees with the measured one"),
        (28.7, 1, "6.9 times the measured scatter. One run shows no scatter of its own: use --replicas 3."),
    ],
)
def test_a_difference_is_told_in_standard_errors_or_beside_one_run_in_scatters(value, n, words):
    assert words in next(measured_value_texts(run_document(value, n)))


def test_what_a_set_up_lacks_is_told_once_and_forbids_the_comparison():
    lack = {"flag": "small_heap", "sentence": "too small", "blocks": True, "stated": False}
    document = run_document(6.2, shortfalls=[lack])
    told = run_warnings(document)
    assert told == ["angle of repose, angle of the cone: too small", "flank not straight (3 of 3 repeats)"]
    assert "cannot be compared" in next(measured_value_texts(document))


def test_a_difference_says_that_the_heap_is_too_small_for_its_angle():
    lack = {"flag": "size", "sentence": "the angle has not converged: 5 rows", "blocks": False}
    told = next(measured_value_texts(run_document(28.7, shortfalls=[lack | {"stated": True}])))
    assert "lower than measured (the angle has not converged): 13.2 standard errors" in told


def test_the_table_has_words_units_and_the_difference():
    document = run_document(28.7)
    simulated, measured = "28.70 \N{PLUS-MINUS SIGN} 0.50", "33.50 \N{PLUS-MINUS SIGN} 0.70 (n = 10)"
    assert run_table(document).rows[0] == ("angle of repose [deg]", simulated, measured, "-4.8 (-14%)")
    assert "view 'my runs/a.rrd'`" in next(step_texts(document | {"recording": "my runs/a.rrd"}))
