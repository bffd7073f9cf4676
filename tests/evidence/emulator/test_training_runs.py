"""The loop on scenes, its campaign replaced by a stand-in: rounds of runs, shared and never made twice."""

import re
import tomllib
from dataclasses import replace
from math import tanh
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_erosion.campaign.request import RunResult
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.emulator import design, training_runs
from taichi_erosion.evidence.emulator.emulator import EmulatorInputs
from taichi_erosion.evidence.models.load_study import NO_OPTIONS, StudyOptions, load_study
from taichi_erosion.evidence.race.priors import SURE
from tests.evidence.asking import SILENT, ask

SCENE = Path(__file__).parents[3] / "scenes" / "column_collapse.toml"
FRICTION = "contact.grain-grain.friction_rolling"
DIAMETERS = (1.5, 3.0)  # mm
NAME = "rolling_resistance"
QUICK = StudyOptions(budget="quick")
SCATTER = 0.01  # of one run and of one laboratory repeat, relative
STUDY = f"""
[study]
measurements = "heap.csv"
[observables.pile_height]
scene = "column_collapse.toml"
transform = "log"
[observables.centroid_height]
scene = "column_collapse.toml"
transform = "log"
[conditions]
angularity = "conditions.angularity"
diameter = "grains.size.diameter"
[parameters]
"{FRICTION}" = {{ start = 0.15, low = 0.02, high = 0.6 }}
[candidates]
effects = ["rolling_resistance", "dry_adhesion"]
"""


def heights(diameter: float, friction: float, rolling: float, sticking: float) -> tuple[float, float]:
    """Heights of pile and centroid [m] in a made-up world."""
    pull = sticking * (1.5e-3 / diameter) ** 2
    steep = tanh(2.0 * (friction + rolling)) + 0.3 * pull
    return diameter * (5.0 + 4.0 * steep), diameter * (1.4 + 1.0 * steep + 0.1 * pull)


def simulated(payload: dict) -> tuple[float, float]:
    """What a run would measure, with its seed's scatter."""
    scene = payload["scene"]
    effects = {name: entry["strength"] for name, entry in scene["effects"].items()}
    rolling = 0.28 * effects.get("rolling_resistance", 0.0) * scene["conditions"]["angularity"]
    friction = scene["contact"]["grain-grain"]["friction_rolling"]
    water = scene["conditions"].get("moisture", 0.0) / 0.01  # over 1 %
    wet = water ** scene["effects"]["liquid_bridge"].get("exponent", 0.68) if water else 0.0
    sticking = effects.get("dry_adhesion", 0.0) + effects.get("liquid_bridge", 0.0) * wet
    pair = heights(scene["grains"]["size"]["diameter"], friction, rolling, sticking)
    noise = np.random.default_rng(payload["seed"]).normal(0.0, SCATTER, 2)
    return pair[0] * np.exp(noise[0]), pair[1] * np.exp(noise[1])


def executing(batches: list[list[str]]):
    """A campaign that notes the keys of the runs it is asked for and makes their results up."""

    def execute(wanted, store, **options):
        batches.append([request.key for request in wanted])
        results = []
        for request in wanted:
            values = zip(("pile_height", "centroid_height"), simulated(request.payload), strict=True)
            measures = {name: {"value": value, "unit": "m"} for name, value in values}
            results.append(RunResult(request.key, {"measures": measures}))
        return results

    return execute


@pytest.fixture
def asked(monkeypatch):
    """Keys of the runs that reach the campaign, batch by batch."""
    batches: list[list[str]] = []
    monkeypatch.setattr(training_runs, "run_requests", executing(batches))
    return batches


def table_of(axis: str, world: dict[float, tuple[float, float]], repeats: int, seed: int) -> str:
    """Heaps of a laboratory in whose world grains roll badly and stick, by the level of an axis."""
    generator = np.random.default_rng(seed)
    lines = [f"observable,value,n,unit,group,{axis},diameter [mm],source"]
    for level, acting in world.items():
        for d in DIAMETERS:
            pair = heights(1e-3 * d, 0.2, *acting)
            for observable, exact in zip(("pile_height", "centroid_height"), pair, strict=True):
                lines += [
                    f"{observable},{value:.6g},1,m,a{level:g},{level:g},{d:g},made"
                    for value in exact * generator.normal(1.0, SCATTER, repeats)
                ]
    return "\n".join(lines) + "\n"


def write(folder: Path, strength: float, text: str = STUDY, seed: int = 1) -> Path:
    """Study and table of a laboratory in whose world angular grains roll badly."""
    world = {a: (0.28 * strength * a, 0.0) for a in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)}
    (folder / "heap.csv").write_text(table_of("angularity", world, 3, seed), encoding="utf-8")
    (folder / SCENE.name).write_text(SCENE.read_text("utf-8"), encoding="utf-8")
    (folder / "heap.toml").write_text(text, encoding="utf-8")
    return folder / "heap.toml"


@pytest.fixture(scope="module")
def loop(tmp_path_factory) -> SimpleNamespace:
    """Replies of the whole loop on one study, the runs of each command, the cost as told before the first."""
    path = write(tmp_path_factory.mktemp("loop"), strength=1.5)
    replies, runs, cost = {}, {}, []
    for name, words, options in (
        ("compare", ("compare", path), NO_OPTIONS),
        ("discover", ("discover", path), replace(QUICK, announce=cost.append)),
        ("adopt", ("adopt", path, NAME), NO_OPTIONS),
        ("after", ("compare", path.with_name(f"heap_with_{NAME}.toml")), NO_OPTIONS),
    ):
        runs[name] = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(training_runs, "run_requests", executing(runs[name]))
            replies[name] = ask(*words, options=options).record
    return SimpleNamespace(**replies, runs=runs, cost=cost[0])


def keys(batches: list[list[str]]) -> set[str]:
    return {key for batch in batches for key in batch}


def test_the_loop_names_what_acts_and_the_held_out_error_falls(loop):
    assert loop.compare.p_misfit < 1e-3
    assert loop.discover.named == (NAME,)
    held = loop.adopt.vault
    assert held.chi2_per_row_after < 0.5 * held.chi2_per_row_before
    fitted = loop.adopt.effects[NAME].strength_range
    # the 90 % interval misses one time in ten, three times its half-width once in a million
    assert abs(fitted.value - 1.5) < 1.5 * (fitted.high - fitted.low)
    assert loop.after.p_misfit > 0.01


def test_a_quick_discovery_takes_about_a_hundred_runs_whose_cost_is_told_before_the_first(loop):
    # 16 bare, 10 of sticking and 14 of rolling; 8 about the bare model for `compare`;
    # 8 about each of three explanations, a pair among them; 2 at each of 8 conditions that are not held out
    # for the name and for a runner-up, of which angularity does not change the bare model
    count = len(keys(loop.runs["discover"]))
    assert loop.discover.runs == count <= 16 + 24 + 8 + 3 * 8 + 2 * (8 + 8 + 2)
    numbers = re.findall(r"(\d+) (?:runs to make|in 1 round|that it ends with)", loop.cost)
    first, later, tests = (int(number) for number in numbers)
    assert first == len(set(loop.runs["discover"][0]))
    assert count <= first + later + tests
    assert re.search(r"at most about [\d.]+ (s|min|h) on \d+ process", loop.cost)
    assert "Where no listed effect suffices, 132 more are made." in loop.cost, "11 times 12"


def test_new_simulations_with_seeds_of_their_own_bear_a_right_name_out_and_train_nothing(loop):
    found, (*training, test) = loop.discover.fresh_runs, loop.runs["discover"]
    assert (found.outcome, found.effects) == ("confirmed", (NAME,))
    assert found.simulated > SURE
    assert len(set(test)) == found.runs
    assert not set(test) & (keys(training) | keys(loop.runs["adopt"]))


def test_no_run_is_made_twice(loop):
    made = keys(loop.runs["discover"])
    assert keys(loop.runs["compare"]) <= made
    assert set(loop.runs["after"][0]) <= made, "bare runs and those of the adopted effect are there"


def test_a_null_stays_a_null_and_starts_from_the_same_runs(tmp_path, loop, asked):
    found = ask("discover", write(tmp_path, strength=0.0), options=QUICK).record
    assert found.verdict in SILENT
    assert found.named == ()
    assert found.fresh_runs is None, "nothing is simulated for a sure null"
    assert len(asked) == 1
    assert set(asked[0]) <= keys(loop.runs["discover"]), "a plan never follows from a measured value"


LACKING = dict(flag="small_heap", sentence="small", found=1.2, needed=3.0, blocks=True, grains=900)


def test_runs_that_stop_and_heaps_that_are_too_small_are_told_before_any_effect(tmp_path, monkeypatch):
    make = executing([])

    def execute(wanted, store, **options):
        results = make(wanted, store)
        for made in results:
            for measure in made.record["measures"].values():
                measure["shortfalls"] = [LACKING]
        stopped = replace(results[0], record={}, failure="grains overlap")
        return [stopped if place % 4 == 0 else made for place, made in enumerate(results)]

    monkeypatch.setattr(training_runs, "run_requests", execute)
    text = STUDY.replace("[observables.centroid_height]", "[observables.centroid_height]\nsame_size = true")
    found = ask("discover", write(tmp_path, 1.5, text), options=QUICK)
    stops, small = found.about["faults"]
    assert (stops["kind"], small["kind"]) == ("failed_runs", "too_small")
    assert re.search(r"runs stopped and are left out.*; the first: grains overlap$", stops["sentence"])
    assert found.about["set_up"][0] == f"error: pile_height: {LACKING['sentence']}"
    assert found.record.verdict == "not_testable"
    assert found.answer().lines[0] == "No effect is named before the errors above are fixed."


@pytest.mark.parametrize("stops", [False, True])
def test_an_effect_whose_strong_runs_stop_is_told_and_not_excluded(tmp_path, monkeypatch, stops):
    make = executing([])

    def execute(wanted, store, **options):
        strengths = [request.payload["scene"]["effects"].get("dry_adhesion", {}) for request in wanted]
        strong = [stops and each.get("strength", 0.0) > 0.1 for each in strengths]
        results = make(wanted, store)
        return [
            replace(made, record={}, failure="grains overlap") if lost else made
            for made, lost in zip(results, strong, strict=True)
        ]

    monkeypatch.setattr(training_runs, "run_requests", execute)
    found = ask("discover", write(tmp_path, 0.0), options=QUICK)
    assert found.record.effects["dry_adhesion"].status == ("untestable" if stops else "excluded")
    told = [fault["sentence"] for fault in found.about["faults"] if fault["kind"] == "failed_runs"]
    assert [bool(re.search(r"left out, (\d+) of \d+ with dry_adhesion;", e)) for e in told] == [True] * stops


def test_doses_keep_the_numbers_that_they_multiply_within_their_usual_range(tmp_path):
    text = STUDY + '[parameters."contact.grain-grain.friction_sliding"]\nstart = 0.9\nlow = 0.5\nhigh = 1.2\n'
    first = training_runs.initial_training_runs(load_study(write(tmp_path, 0.0, text=text)), (), "quick")
    doses = {each.name: (each.low, each.high) for each in training_runs.add_dose_runs(first).mechanisms}
    assert doses["sliding_friction"] == pytest.approx((-0.95, 1.5 / 0.9 - 1.0))
    assert doses["restitution"][1] == pytest.approx(1.0 / 0.5 - 1.0)
    assert doses["gap_pull"] == (0.0, 100.0)


RANGES = "[laboratory]\nranges = { angularity = [0.0, 1.0] }\n"


@pytest.mark.parametrize("most", [24, pytest.param(60, marks=pytest.mark.slow)])
def test_no_command_and_not_all_of_them_together_pass_the_budget(tmp_path, asked, most):
    path = write(tmp_path, 1.5, text=f"{STUDY}{RANGES}[budget]\nruns = {most}\n")
    commands = [("compare", ()), ("discover", ()), ("adopt", (NAME,)), ("next", ())]
    for command, effects in commands if most > 24 else commands[:2]:
        found = ask(command, path, *effects).record
        assert 0 < len(keys(asked)) <= most
    assert len(keys(asked)) > 0.6 * most, "most of what may be spent is spent"
    if most == 24:
        assert (found.named, found.fresh_runs.outcome) == ((NAME,), "not_made")
        assert found.fresh_runs.needed > most - len(keys(asked))


def test_a_budget_that_is_too_small_is_refused_before_the_first_run(tmp_path, asked):
    with pytest.raises(BadInput, match="a budget of 10 runs is too small; the study needs at least 16"):
        ask("discover", write(tmp_path, 1.5), options=StudyOptions(runs=10))
    assert not asked


MOIST = (
    STUDY.replace('angularity = "conditions.angularity"', 'moisture = "conditions.moisture"')
    .replace('"rolling_resistance"', '"liquid_bridge"')
    .replace("heap.csv", "moist.csv")
)


@pytest.mark.slow
def test_how_an_effect_grows_with_its_condition_is_calibrated_with_it(tmp_path, asked):
    power = 1.2  # the library's own is 0.68
    world = {w: (0.0, 0.8 * (w / 0.01) ** power) for w in (0.0, 0.005, 0.01, 0.02, 0.04)}
    path = write(tmp_path, 0.0, text=MOIST)
    (tmp_path / "moist.csv").write_text(table_of("moisture", world, 4, 1), encoding="utf-8")
    found = ask("discover", path, options=QUICK).record
    assert found.named == ("liquid_bridge",)
    fitted = found.parameters["effects.liquid_bridge.exponent"]
    assert abs(fitted.value - power) < 1.5 * (fitted.high - fitted.low)
    assert found.chi2_after < 0.05 * found.chi2_before

    adopted = ask("adopt", path, "liquid_bridge").record
    assert adopted.vault.chi2_per_row_after < 0.1 * adopted.vault.chi2_per_row_before
    fitted = adopted.parameters["effects.liquid_bridge.exponent"]
    scene = tomllib.loads((tmp_path / "column_collapse_heap_with_liquid_bridge.toml").read_text("utf-8"))
    assert scene["effects"]["liquid_bridge"]["exponent"] == pytest.approx(fitted.value, rel=1e-4)
    after = ask("compare", tmp_path / "heap_with_liquid_bridge.toml").record
    assert after.p_misfit > 0.01
    assert "effects.liquid_bridge.exponent" in after.parameters


def test_a_factor_of_a_calibrated_number_is_that_number_and_doses_go_both_ways(tmp_path):
    first = training_runs.initial_training_runs(load_study(write(tmp_path, 0.0)), (), "quick")
    (scene,) = (wider := training_runs.add_dose_runs(first)).scenes
    factors = design.mechanisms_scaling_numbers(scene)
    assert factors == {"rolling_friction": FRICTION}
    axes = tuple(axis for axis in scene.axes if axis.name == FRICTION)
    inputs = EmulatorInputs(scene, axes, {}, (), ("stiffness",), factors)
    halved = inputs.standardise(1, {}, {FRICTION: np.full(1, 0.2)}, {"rolling_friction": np.full(1, -0.5)})
    np.testing.assert_allclose(halved.x, inputs.standardise(1, {}, {FRICTION: np.full(1, 0.1)}, {}).x)
    assert not halved.psi.any()
    for each in wider.mechanisms:
        doses = [design.strength_at_share(each, share) for share in (0.0, 0.25, 0.75, 1.0)]
        np.testing.assert_allclose((doses[0], doses[-1]), (each.low, each.high))
        assert (doses[1] < 0.0) == (each.low < 0.0)
        assert doses[2] > 0.0
