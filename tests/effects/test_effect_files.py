"""Files that users begin: from the scaffold, and from a law that a discovery proposed."""

import json
from collections.abc import Iterator
from pathlib import Path
from shutil import copy

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.effect_probe import Bench, make_bench
from taichi_erosion.core.setup import Numerics
from taichi_erosion.effects import load_library
from taichi_erosion.verification.effect_contract import breaches

LAW = {
    "observable": "threshold_u_star",
    "expression": "change of ln threshold_u_star = +0.852 (diameter / 0.00025)^-1 -0.1 (moisture / 0.02)^2",
    "terms": [{"diameter": -1.0}, {"moisture": 2.0}],
    "coefficients": [0.852, -0.1],
    "held_out_share": 0.62,
}


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    start_device(Numerics("cpu", 1))
    yield make_bench()
    stop_device()


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def discovery(folder: Path, *laws: object) -> str:
    file = folder / "soil.discover.json"
    file.write_text(json.dumps({"clues": [{"law": law} for law in laws]}), encoding="utf-8")
    return str(file)


def test_the_scaffold_keeps_the_contract_as_it_is(here, bench, capsys):
    assert main(["effects", "new", "my_pull"]) == 0
    assert capsys.readouterr().out.strip() == "my_pull.py"
    assert breaches(load_library([here / "my_pull.py"])["my_pull"], bench) == []


@pytest.mark.parametrize("place", ["pair", "grain", "scene", "instrument"])
def test_the_scaffold_of_every_place_keeps_the_contract_as_it_is(place, here, bench):
    assert main(["effects", "new", "mine", "--place", place]) == 0
    effect = load_library([here / "mine.py"])["mine"]
    assert (effect.place, breaches(effect, bench)) == (place, [])


def test_the_scaffold_with_a_memory_keeps_the_contract_as_it_is(here, bench):
    assert main(["effects", "new", "my_memory", "--with-memory"]) == 0
    effect = load_library([here / "my_memory.py"])["my_memory"]
    assert effect.grain_state is not None
    assert breaches(effect, bench) == []


def test_an_installed_package_adds_its_effects(here, monkeypatch):
    about = here / "dust-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: dust\nVersion: 1.0\n", encoding="utf-8")
    (about / "entry_points.txt").write_text("[taichi_erosion.effects]\ndust = dust_pull\n", encoding="utf-8")
    copy(Path(__file__).with_name("constant_pull.py"), here / "dust_pull.py")
    assert "constant_pull" not in load_library()
    monkeypatch.syspath_prepend(here)
    assert load_library()["constant_pull"].title == "constant pull between touching grains"


@pytest.mark.parametrize("scale", ["change of ln threshold_u_star", "change of threshold_u_star"])
def test_a_discovered_law_becomes_an_effect_that_keeps_the_contract(scale, here, bench):
    law = LAW | {"expression": LAW["expression"].replace("change of ln threshold_u_star", scale)}
    assert main(["effects", "new", "found", "--from-discovery", discovery(here, None, law)]) == 0
    effect = load_library([here / "found.py"])["found"]
    assert breaches(effect, bench) == []
    assert effect.reads == ("diameter", "moisture")


def test_a_discovered_law_gives_what_the_discovery_wrote(here):
    main(["effects", "new", "found", "--from-discovery", discovery(here, LAW)])
    effect = load_library([here / "found.py"])["found"]
    dry = {"diameter": 1.25e-4, "moisture": 1e-12}
    wet = {"diameter": 2.5e-4, "moisture": 0.04}
    # at half the diameter ln y rises by twice 0.852, at twice the moisture by 0.852 less four times 0.1
    assert effect.act(effect.params(), 1.0, dry, "threshold_u_star", 0.2) == pytest.approx(0.2 * 5.4959, 1e-4)
    assert effect.act(effect.params(), 1.0, wet, "threshold_u_star", 0.2) == pytest.approx(0.2 * 1.5715, 1e-4)
    assert effect.act(effect.params(), 1.0, {"diameter": 1e-4}, "threshold_u_star", 0.2) == 0.2


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["new", "Pull"], "a name begins with a lower-case letter and has lower-case letters, digits and _"),
        (["new", "dry_adhesion"], "the library has an effect of this name"),
        (["new"], "is not in the library"),
        (["dry_adhesion", "--from-discovery", "x.json"], "needs new NAME"),
        (["dry_adhesion", "--with-memory"], "needs new NAME"),
        (["dry_adhesion", "--place", "grain"], "needs new NAME"),
        (["new", "found", "--from-discovery", "x.json"], "is not a result of discover"),
    ],
)
def test_a_wrong_word_gets_one_line(words, sentence, capsys):
    assert main(["effects", *words]) == 2
    assert sentence in capsys.readouterr().err


def test_a_discovery_without_a_law_begins_no_file(here, capsys):
    assert main(["effects", "new", "found", "--from-discovery", discovery(here, None)]) == 2
    assert "no law" in capsys.readouterr().err
    assert not (here / "found.py").exists()


def test_a_law_may_read_a_condition_that_only_its_study_has(here, bench):
    strange = LAW | {
        "expression": "change of ln y = +0.5 (colour / 2)^1",
        "terms": [{"colour": 1.0}],
        "coefficients": [0.5],
    }
    assert main(["effects", "new", "found", "--from-discovery", discovery(here, strange)]) == 0
    effect = load_library([here / "found.py"])["found"]
    assert (effect.reads, breaches(effect, bench)) == (("colour",), [])


def test_the_library_is_listed_with_what_was_measured_of_each_effect(capsys):
    assert main(["effects", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["effects"]
    assert set(listed) == set(load_library())
    assert all(page["reference"] for page in listed.values())
    moved = {row["observable"] for row in listed["rolling_resistance"]["measured"]}
    assert "angle_of_repose" in moved
