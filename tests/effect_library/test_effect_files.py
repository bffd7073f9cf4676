"""Files that users begin: from the scaffold, and from a law that a discovery proposed."""

from dataclasses import replace
from pathlib import Path

import pytest
from ten_records import DISCOVERIES

from taichi_erosion.cli.main import main
from taichi_erosion.core.effect import Effect
from taichi_erosion.effect_library import load_library
from taichi_erosion.evidence.answers.files import FORMAT, Reply, write_reply
from taichi_erosion.evidence.record import DosePart, Interval, LawPart, MechanismPart
from taichi_erosion.verification.effect_contract import breaches, usable_probe

# colour is a condition that only the study of the law has
LAW = LawPart(
    "rolling_friction",
    ("diameter", "colour"),
    "power of two conditions",
    "0.852 (diameter / 0.00025)^-1 (colour / 2)^2",
    'params.a * (at["diameter"] / 0.00025) ** params.p * (at["colour"] / 2) ** params.q',
    {"a": Interval(0.852, 0.7, 1.0), "p": Interval(-1.0, -1.2, -0.8), "q": Interval(2.0, 1.8, 2.2)},
    {"diameter": -1.0, "colour": 2.0},
    {"diameter": -1.2, "colour": 1.8},
    {"diameter": -0.8, "colour": 2.2},
    0.62,
)
DOSES = (
    DosePart({"diameter": 2.5e-4, "colour": 2.0}, 0.852, 0.7, 1.0),
    DosePart({"diameter": 1.25e-4, "colour": 2.0}, 1.704, 1.4, 2.0),
    DosePart({"diameter": 2.5e-4, "colour": 4.0}, 3.408, 3.0, 4.0),
)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def discovery(folder: Path, law: LawPart | None) -> str:
    about = {"format": FORMAT, "study": "soil.toml"}
    mechanisms = {law.mechanism: MechanismPart(0.9, DOSES, law)} if law else {}
    write_reply(folder, "soil", Reply("discover", about, replace(DISCOVERIES["null"], mechanisms=mechanisms)))
    return str(folder / "soil.discover.json")


@pytest.mark.parametrize(
    "words", [[], *(["--place", place] for place in ("grain", "scene", "instrument")), ["--with-memory"]]
)
def test_the_scaffold_keeps_the_contract_as_it_is(words, here, bench, capsys):
    assert main(["effects", "new", "mine", *words]) == 0
    assert capsys.readouterr().out.strip() == "mine.py"
    effect = load_library([here / "mine.py"])["mine"]
    assert breaches(effect, usable_probe(effect, bench)) == []
    assert effect.place == (words[1] if words[1:] else "pair")
    assert (effect.grain_state is None) == (words != ["--with-memory"])


def read_law(here: Path, law: LawPart) -> Effect:
    """The effect that is written of a discovered law."""
    assert main(["effects", "new", "found", "--from-discovery", discovery(here, law)]) == 0
    return load_library([here / "found.py"])["found"]


def test_a_discovered_law_becomes_an_effect_that_gives_what_the_discovery_wrote(here, bench):
    effect = read_law(here, LAW)
    assert breaches(effect, usable_probe(effect, bench)) == []
    assert (effect.reads, effect.mechanism) == (("diameter", "colour"), "rolling_friction")
    for each in DOSES:
        assert effect.dose(effect.params(), each.conditions) == pytest.approx(each.dose)
    assert effect.dose(effect.params(), {"diameter": 1e-4}) == 0.0
    assert "D = a (diameter / 0.00025)^p (colour / 2)^q" in str(effect.doc)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["new", "Pull"], "a name begins with a lower-case letter and has lower-case letters, digits and _"),
        (["new", "dry_adhesion"], "there is an effect or a file of this name"),
        (["new"], "give one NAME, or new NAME"),
        (["dry_adhesion", "--from-discovery", "x.json"], "needs new NAME"),
        (["dry_adhesion", "--place", "grain"], "needs new NAME"),
        (["new", "found", "--from-discovery", "x.json"], "is not a result of discover"),
    ],
)
def test_a_wrong_word_gets_one_line(words, sentence, capsys):
    assert main(["effects", *words]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("law", "sentence"),
    [
        (None, "no law"),
        (replace(LAW, mechanism="liquid_bridge"), "which is in the list of effects"),
        (replace(LAW, python="__import__('os')"), "is not one that discover writes"),
    ],
)
def test_a_discovery_without_a_law_of_a_mechanism_begins_no_file(law, sentence, here, capsys):
    assert main(["effects", "new", "found", "--from-discovery", discovery(here, law)]) == 2
    assert sentence in capsys.readouterr().err
    assert not (here / "found.py").exists()


def test_a_law_of_a_force_keeps_the_contract_too(here, capsys):
    """The last test: it starts a device of its own."""
    read_law(here, replace(LAW, mechanism="contact_pull"))
    assert main(["effects", "found", "--effect", "found.py"]) == 0
    assert "It keeps the contract of effects." in capsys.readouterr().out
