import json
import re
from dataclasses import replace
from math import nan

import pytest
from ten_records import (
    ADOPTIONS,
    DISCOVERIES,
    VOC,
    WET,
    adopted,
    curved,
    group,
    level,
    mechanism,
    null,
    pair,
    single,
)

from taichi_erosion.evidence.answers.files import RECORD, STORED, with_adoption
from taichi_erosion.evidence.record import EffectPart, ErrorPart, FreshPart, Interval, LevelPart, ScatterPart
from taichi_erosion.evidence.words.answer_lines import (
    Answer,
    adopt_answer,
    compare_answer,
    discover_answer,
    next_answer,
)

MOST_LINES = 8
CONTRACT = set(
    "verdict named group probabilities effects parameters where chi2_before chi2_after "
    "n vault next_experiments mechanisms runs wall_s seed".split()
)
KNOWN = {*null.effects, "rolling_friction", "contact_pull"}
ANSWERS = [
    *(discover_answer(record, VOC) for record in DISCOVERIES.values()),
    *(compare_answer(record, VOC) for record in DISCOVERIES.values()),
    *(adopt_answer(record, VOC) for record in ADOPTIONS.values()),
    *(next_answer(record, VOC) for record in DISCOVERIES.values()),
]


def named_in(text: str) -> set[str]:
    return {name for name in KNOWN if re.search(rf"\b{name}\b", text)}


def acting_rows(answer: Answer) -> set[str]:
    rows = answer.table.rows if answer.table else ()
    return {row[0] for row in rows if row[1] == "present" or "one of them acts" in row[1]}


def test_new_simulations_that_tested_an_answer_are_told():
    told = discover_answer(replace(single, fresh_runs=FreshPart("confirmed", runs=12)), VOC).lines
    assert any(line.endswith("12 new simulations confirm the answer.") for line in told)
    for outcome, words, runs in (
        ("contradicted", "change the answer", 24),
        ("undecided", "leave it open", 0),
    ):
        part = FreshPart(outcome, runs=12, more_runs=runs)
        first, *_, last = discover_answer(replace(DISCOVERIES["unstable"], fresh_runs=part), VOC).lines
        assert (words in first, "makes more runs" in last) == (True, runs > 0)


@pytest.mark.parametrize("answer", ANSWERS)
def test_an_answer_has_at_most_eight_lines_of_whole_sentences_without_gaps(answer: Answer):
    assert 1 <= len(answer.lines) <= MOST_LINES
    assert all(line.endswith(".") and "  " not in line and "nan" not in line for line in answer.lines)
    assert answer.table is None or {len(row) for row in answer.table.rows} == {len(answer.table.columns)}


@pytest.mark.parametrize("name", DISCOVERIES)
def test_headline_table_and_last_line_name_the_same(name: str):
    record = DISCOVERIES[name]
    answer = discover_answer(record, VOC)
    first = answer.lines[0]
    acting = named_in(first) if first.startswith("Missing") else set()
    assert acting == acting_rows(answer)
    assert acting == named_in(answer.lines[-1])
    assert not acting or acting == {*record.named, *record.group, *record.acting_mechanisms}
    assert first.startswith("Missing") == (record.verdict in ("present", "group", "outside_library"))


def test_a_status_that_contradicts_the_decision_is_not_told():
    shown = single.effects["liquid_bridge"]
    effects = single.effects | {"liquid_bridge": null.effects["liquid_bridge"], "side_walls": shown}
    assert acting_rows(discover_answer(replace(single, effects=effects), VOC)) == {"liquid_bridge"}


def test_with_an_effect_and_a_group_the_last_line_has_a_step_for_both():
    last = discover_answer(replace(group, named=("liquid_bridge",)), VOC).lines[-1]
    assert "adopt lab.toml liquid_bridge`" in last
    assert named_in(last) == {"liquid_bridge", "dry_cohesion", "side_walls"}


def test_a_law_stands_in_the_first_sentence_in_the_units_of_the_table():
    first = discover_answer(mechanism, VOC).lines[0]
    assert "(moisture / 5 %)^1.2" in first
    assert "1 + 0.81" in first
    part = mechanism.mechanisms["rolling_friction"]
    falling = replace(part.law, numbers=part.law.numbers | {"a": Interval(-0.4, -0.5, -0.3)})
    mechanisms = {"rolling_friction": replace(part, law=falling)}
    assert "1 - 0.4 (" in discover_answer(replace(mechanism, mechanisms=mechanisms), VOC).lines[0]
    unsaid = discover_answer(replace(null, mechanisms=mechanisms), VOC)  # a law of what is not said to act
    assert not re.search("moisture /|^Law", "\n".join(unsaid.lines), re.MULTILINE)


@pytest.mark.parametrize("name", ADOPTIONS)
def test_the_error_falls_only_to_a_model_that_is_adequate_on_fitted_and_held_out_rows(name: str):
    text = " ".join(adopt_answer(ADOPTIONS[name], VOC).lines)
    assert ("The error falls" in text) == (name == "adopted")
    assert ("still fails" in text) == name.endswith("fails")
    assert ("biased without" in text) == (name == "adopted")
    assert ("lab_adopted.toml" in text) == (name != "refuted")


@pytest.mark.parametrize(("p", "falls"), [(0.0099, False), (0.01, True), (nan, True)])
def test_chances_on_both_sides_of_the_level_of_a_misfit(p, falls):
    record = replace(adopted, vault=replace(adopted.vault, p_after=p))
    assert adopt_answer(record, VOC).lines[0].startswith("The error falls") == falls


@pytest.mark.parametrize("held", [None, replace(adopted.vault, n=0)])
def test_rows_that_test_nothing_are_not_told_as_a_success(held):
    answer = adopt_answer(replace(adopted, vault=held), VOC)
    assert "falls" not in " ".join(answer.lines)
    assert answer.table is None


def test_a_strength_at_the_limit_of_the_list_is_told_and_its_interval_holds_it():
    assert "limit" in discover_answer(pair, VOC).lines[0]
    assert "limit" not in discover_answer(single, VOC).lines[0]
    told = re.findall(r"strength ([\d.]+) \(([\d.]+) to ([\d.]+)\)", discover_answer(pair, VOC).lines[0])
    assert len(told) == len(pair.named)
    assert all(float(low) <= float(value) <= float(high) for value, low, high in told)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"status": "excluded", "limit": 0.123}, "excluded above 0.12"),
        ({"status": "open", "unseen_below": 0.456}, "cannot be ruled out below 0.46"),
        ({"status": "open", "unseen_below": nan}, "not testable here"),
        ({"status": "untestable"}, "not testable here"),
        ({"status": "better_but_not_sufficient"}, "better than nothing but not sufficient"),
        ({"status": "open", "alike": ("side_walls",)}, "not told apart from side_walls"),
    ],
)
def test_statuses_in_words(changes: dict, words: str):
    part: EffectPart = replace(null.effects["liquid_bridge"], **changes)
    assert words in discover_answer(replace(null, effects={"liquid_bridge": part}), VOC).table.rows[0][1]


def test_levels_have_the_unit_and_the_sign_of_the_table():
    below = replace(level, levels=(LevelPart(-6e-4, -8e-4, 1e-4, "radius_90", "offset", 0.99),))
    told = [" ".join(discover_answer(record, VOC).lines) for record in (level, below)]
    assert "the radius of 90 % of the grains reads 0.6 mm (0.4 to 0.8) more" in told[0]
    assert "0.6 mm (-0.1 to 0.8) less" in told[1]


@pytest.mark.parametrize("record", [*DISCOVERIES.values(), replace(null, where=single.where)])
def test_a_comparison_asks_for_an_effect_where_it_fails_as_a_whole_or_in_a_place(record):
    answer = compare_answer(record, VOC)
    first, last = answer.lines[0], answer.lines[-1]
    assert ("fails" in first) == any("Where the model fails" in line for line in answer.lines)
    assert ("fails" in first) == any(row[-1] != "nowhere" for row in answer.table.rows)
    if not record.repeats:
        assert ("fails" in first) == ("discover" in last)


def test_proposals_are_told_in_the_units_of_the_table_or_as_none():
    answer = next_answer(group, VOC)
    place = "threshold friction velocity [cm/s]", "moisture = 0 %, diameter = 200 um"
    assert answer.table.rows[1][:3] == (*place, "31 (29 to 33)")
    assert next_answer(null, VOC).lines[0].startswith("One explanation has probability 0.94; measurements")


@pytest.mark.parametrize("record", [*DISCOVERIES.values(), *ADOPTIONS.values()])
def test_the_document_is_json_with_the_keys_of_the_contract(record):
    found = json.loads(json.dumps(RECORD.dump_python(record, exclude=STORED), allow_nan=False))
    assert found.keys() >= CONTRACT
    keys = {"status", "strength", "strength_low", "strength_high", "log_bayes_factor", "absorption"}
    assert all(keys <= part.keys() for part in found["effects"].values())
    assert all({"value", "low", "high"} <= part.keys() for part in found["parameters"].values())
    assert set(record.acting_mechanisms) <= found["mechanisms"].keys()
    if record.vault is not None:
        assert found["vault"]["chi2_after"] == pytest.approx(record.vault.n * record.vault.chi2_per_row_after)
    if record.law is not None:
        law = found["mechanisms"][record.law.mechanism]["law"]
        assert law["low"]["moisture"] < law["exponents"]["moisture"] < law["high"]["moisture"]


def test_a_name_that_adopt_refuted_is_neither_named_nor_to_be_adopted_again():
    told = with_adoption(single, ADOPTIONS["refuted"])
    answer = discover_answer(told, VOC)
    assert (told.named, told.refuted) == ((), ("liquid_bridge",))
    assert answer.lines[0].startswith("No effect is named")
    assert "Do not adopt" in " ".join(answer.holds)
    assert "adopt lab.toml" not in answer.lines[-1]
    assert acting_rows(answer) == set()
    assert with_adoption(pair, ADOPTIONS["refuted"]) == pair, "of other names nothing is known"
    alone = replace(adopted.vault, chi2_per_row_wrong_effect=nan, alike={"moisture": 0.05})
    lacks = adopt_answer(replace(adopted, vault=alone), VOC).lines[1]
    assert "no other candidate. All held-out rows have moisture = 5 %: no other value is tested." in lacks


@pytest.mark.parametrize("name", ["adopted", "still_fails", "fitted_fails"])
def test_after_an_adoption_discover_and_adopt_end_with_the_same_step(name: str):
    adopted = ADOPTIONS[name]
    answers = discover_answer(with_adoption(single, adopted), VOC), adopt_answer(adopted, VOC)
    assert (answers[0].lines[-1], acting_rows(answers[0])) == (answers[1].lines[-1], {"liquid_bridge"})


def test_the_probability_of_something_unlisted_counts_it_beside_effects_too():
    beside = replace(curved, unlisted=0.97, probabilities={"liquid_bridge": 0.95, "outside_library": 0.02})
    words = r"\(probability 0\.97\)\. It acts with moisture: .* and falls relative to the model\.$"
    assert re.search(words, discover_answer(beside, VOC).lines[0])


def test_a_misfit_that_only_repeats_show_is_told_as_theirs():
    record = replace(null, p_lack_of_fit=0.002)
    first, *_, last = compare_answer(record, VOC).lines
    assert "than their repeats allow" in first
    assert "discover" in last
    assert "agrees" not in first + discover_answer(record, VOC).lines[0]


def test_agreement_names_a_scatter_that_is_larger_than_stated() -> None:
    wide = replace(null, errors=(ErrorPart(2.9, 2.2, 3.9, "scatter", "repose_angle", ""),))
    for answer in (compare_answer, discover_answer):
        assert "if the angle of repose scatters 2.9 times as much" in answer(wide, VOC).lines[0]
        assert " if " not in answer(null, VOC).lines[0]


def test_what_is_unusual_of_a_model_that_follows_its_rows_is_told_in_place_of_a_failure() -> None:
    record = replace(null, p_misfit=1e-3, chi2_before=0.3 * null.n)
    adopted = {name: replace(part, start=0.0) for name, part in null.parameters.items()}
    words = r"follows all .*, by an unusual \w+ \w+, [\d.]+ where about [\d.]+ is expected"
    for answer in (compare_answer, discover_answer):
        assert re.search(words, answer(record, VOC).lines[0])
        assert "by levels or set-ups" in answer(replace(record, parameters=adopted), VOC).lines[0]
        assert "fails" in answer(replace(record, chi2_before=2.0 * null.n), VOC).lines[0]


def test_no_missing_effect_is_seen_only_where_the_model_fails_nowhere() -> None:
    record = replace(null, p_misfit=1e-3, probabilities={"none": 0.95, "outside_library": 0.05})
    assert "by errors of measurement" in discover_answer(replace(record, levels=level.levels), VOC).lines[0]
    first = discover_answer(replace(record, where=(WET,)), VOC).lines[0]
    assert re.fullmatch("No effect is named.* fails .*, errors of measurement alone, has .* 0.95.", first)


def test_a_trend_that_the_stated_scatter_does_not_make_is_no_failure_and_no_agreement() -> None:
    trend, rare = replace(null, where=(replace(WET, p=0.3, p_as_stated=1e-3),)), replace(null, p_misfit=0.03)
    for answer in (compare_answer, discover_answer):
        both = answer(trend, VOC).lines[0] + answer(rare, VOC).lines[0]
        assert re.search("has a trend that the stated scatter would not make.*has a misfit that chance", both)
        assert not re.search("agree|fails", both)


@pytest.mark.parametrize(
    ("kind", "sd", "repeats", "factor", "words"),
    [
        ("offset", 0.8, 40, nan, "angle of repose 0.8 deg, from repeats or blocks (40 degrees of freedom)"),
        ("factor", 0.08, 0, nan, "angle of repose 8 %, from what is stated."),
        ("offset", 1.2, 6, 4.6, "which scatter 4.6 times as much"),
    ],
)
def test_compare_says_how_large_the_scatter_is_and_what_gave_it(kind, sd, repeats, factor, words):
    scatter = (ScatterPart("repose_angle", kind, sd, repeats, factor),)
    assert words in " ".join(compare_answer(replace(null, scatter=scatter), VOC).holds)


def test_of_two_soils_one_lies_above_the_other_beside_their_conditions():
    lower = ErrorPart(-2.8, -3.6, -2.0, "group", "repose_angle", "loam B", "loess A")
    times = ErrorPart(0.654, 0.6, 0.7, "source", "flux", "trap B", "trap A", is_factor=True)
    told = " ".join(str(discover_answer(replace(single, errors=(e,)), VOC).lines) for e in (lower, times))
    assert "of trap B is 0.654 (0.6 to 0.7) times that of trap A, beyond" in told
    assert "of loam B lies 2.8 deg (2 to 3.6) below loess A, beyond what their conditions explain" in told
