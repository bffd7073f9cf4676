"""The command line as a shell sees it: exit code, stdout for results, stderr for everything else.

The rooms behind the commands are replaced by stand-ins, so that only the translation of words is tested.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import get_args, get_type_hints

import numpy as np
import pytest

from taichi_erosion.cli import commands
from taichi_erosion.cli.main import main
from taichi_erosion.cli.output import cost_line
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.core.setup import Numerics
from taichi_erosion.effect_library import load_library
from taichi_erosion.evidence.models.reduced import EFFECTS
from taichi_erosion.verification.claims import Claim

DOCUMENT = {
    "scene": "funnel",
    "hash": "0123456789ab",
    "seed": 1,
    "replicas": [{"seed": 1, "measures": {}, "warnings": [f"warning {k}" for k in range(30)]}],
    "measures": {
        "repose_angle": {"value": 32.914, "sd": 0.514, "unit": "deg", "n": 2},
        "height": {"value": 0.0123456, "sd": float("nan"), "unit": "m", "n": 1},
    },
    "measured": {"repose_angle": {"value": 33.52, "sd": 0.68, "n": 10, "source": "Hao et al. 2022"}},
    "grain_steps": 6_000_000,
    "wall_s": 2.0,
    "recording": Path("recordings/funnel.rrd"),
    "versions": {},
}
HELD = Claim("a sphere falls freely", 1.0, 1.0, 1e-6, "f64", "V01", True, 0.1)
BROKEN = Claim("a sphere bounces", float("nan"), 2.0, 1e-6, "f32", "V02", False, 0.1)
VALID = {"scene": "funnel", "hash": "abc", "effects": []}
SCENE, RECORDING, PICTURE = Path("s.toml"), Path("a.rrd"), Path("a.png")
CHECKED = ((SCENE, ("a=1",), (), commands.check_effect_file), {})
DRAWN = ((RECORDING, 0.5, PICTURE), {"view": None, "source": RECORDING})


@pytest.fixture
def room(monkeypatch):
    """Function that puts a stand-in where a command imports a room, and returns the calls it received."""

    def replace(module, name, answer):
        calls = []

        def stand_in(*arguments, **words):
            calls.append((arguments, words))
            if isinstance(answer, BaseException):
                raise answer
            return answer(*arguments) if callable(answer) else answer

        substitute = ModuleType(module)
        setattr(substitute, name, stand_in)
        substitute.RunOptions = SimpleNamespace
        monkeypatch.setitem(sys.modules, module, substitute)
        return calls

    return replace


def run_scene(room, answer=DOCUMENT):
    return room("taichi_erosion.execution", "run_scene", answer)


def test_words_of_run_arrive_as_options_and_only_those_that_were_typed(room, tmp_path):
    calls = run_scene(room)
    target = tmp_path / "a.rrd"
    words = "--set run.seed=3 --set a.b=1 --replicas 3 --arch cpu --record".split()
    assert main(["run", "scene.toml", *words, str(target)]) == 0
    (((path, options), _),) = calls
    assert path == Path("scene.toml")
    typed = vars(options)
    assert callable(typed.pop("progress"))
    usual = {"no_record": False, "force": False, "effect_files": ()}
    words = {"overrides": ("run.seed=3", "a.b=1"), "replicas": 3, "arch": "cpu", "record": target}
    assert typed == words | usual


def test_a_run_is_told_in_ten_lines_beside_its_table(room, capsys, monkeypatch):
    tables = []
    monkeypatch.setattr("taichi_erosion.cli.output.print_table", lambda *table: tables.append(table))
    run_scene(room)
    assert main(["run", "scene.toml"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert len(tables) == 1
    assert len(printed) <= 10
    assert any(line.startswith("The angle of repose agrees") for line in printed)
    assert main(["run", "scene.toml", "--verbose"]) == 0
    printed = capsys.readouterr().out
    assert "warning: warning 29" in printed
    assert "3e+06 grain-steps/s" in printed


def test_json_of_run_is_one_document_that_any_reader_accepts(room, capsys, monkeypatch):
    monkeypatch.setattr("taichi_erosion.cli.progress.LINE_INTERVAL", 0.0)
    monkeypatch.delenv("FORCE_COLOR", raising=False)

    def simulate(_scene, options):
        options.progress(0.25, "t = 0.1 s")
        return DOCUMENT

    run_scene(room, simulate)
    assert main(["run", "scene.toml", "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err == "simulating: 25%, t = 0.1 s\n"
    document = json.loads(printed.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert document["measures"]["repose_angle"]["value"] == 32.914
    assert document["measures"]["height"]["sd"] is None
    assert document["recording"] == "recordings/funnel.rrd"


TRANSLATED = [  # words, what answers them and how, with which arguments, exit code, what is printed
    ("run s.toml --check --set a=1", "execution.check_scene", VALID, CHECKED, 0, "s.toml: valid, hash abc\n"),
    ("schema -o s.json", "scene.write_schema", None, ((Path("s.json"),), {}), 0, "s.json\n"),
    ("snapshot a.rrd --time 0.5 -o a.png", "recording.viewer.render_picture", PICTURE, DRAWN, 0, "a.png\n"),
    ("view a.rrd", "recording.viewer.open_viewer", 7, None, 7, ""),
]


@pytest.mark.parametrize(("words", "function", "answer", "arguments", "code", "printed"), TRANSLATED)
def test_words_arrive_as_arguments(
    words, function, answer, arguments, code, printed, room, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    RECORDING.touch()
    module, _, name = f"taichi_erosion.{function}".rpartition(".")
    calls = room(module, name, answer)
    assert (main(words.split()), capsys.readouterr().out) == (code, printed)
    assert arguments is None or calls == [arguments]


@pytest.mark.parametrize(
    ("failure", "code", "line"),
    [
        (BadInput("scene.toml: grains.count = -1 lies\noutside [1, 1000000]"), 2, "outside [1, 1000000]"),
        (SimulationStopped("grains 3 and 7 overlap by 0.4 at t = 0.2 s"), 3, "grains 3 and 7"),
        (KeyboardInterrupt("recording recordings/a.rrd"), 130, "interrupted; recording recordings/a.rrd"),
        (ZeroDivisionError("division by zero"), 1, "unexpected ZeroDivisionError: division by zero"),
    ],
    ids=["bad input", "guarded stop", "Ctrl-C", "a mistake of ours"],
)
def test_every_failure_is_one_line_and_its_exit_code(room, capsys, monkeypatch, failure, code, line):
    run_scene(room, failure)
    assert main(["run", "scene.toml", "--json"]) == code
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert line in printed.err
    monkeypatch.setenv("TAICHI_EROSION_TRACEBACK", "1")  # for those who ask for it
    assert main(["run", "scene.toml"]) == code
    assert ("Traceback" in capsys.readouterr().err) == (code == 1)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["run"], "SCENE"),
        (["run", "s.toml", "--arch", "abacus"], "abacus"),
        (["run", "s.toml", "--replicas", "0"], "--replicas"),
        (["run", "s.toml", "--record", "a.rrd", "--no-record"], "--no-record"),
        (["run", "s.toml", "--every", "1"], "--checkpoint"),
        (["run", "s.toml", "--every", "nan", "--checkpoint", "c.npz"], "--every nan"),
        (["run", "s.toml", "--resume", "missing.npz"], "missing.npz"),
        (["measure", "repose", "missing.png"], "missing.png"),
        (["measure", "repose", __file__, "--crop", "1,2,3"], "--crop 1,2,3"),
        (["schema", "-o", "missing/folder/s.json"], "missing/folder"),
        (["--log", "missing/folder/log", "effects"], "--log"),
        (["erode"], "erode"),
    ],
    ids=" ".join,
)
def test_a_word_that_cannot_be_used_is_named_in_one_line(room, capsys, words, named):
    calls = run_scene(room)
    assert main(words) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert named in printed.err
    assert calls == []


def test_verify_fails_as_a_whole_where_one_claim_fails(monkeypatch, capsys):
    calls = []

    def verify(ladder, ids, **words):
        calls.append((ids, words))
        return [HELD, BROKEN]

    monkeypatch.setattr("taichi_erosion.verification.claims.verify_claims", verify)
    assert main(["verify", "V01", "V02", "--json"]) == 1
    ((ids, words),) = calls
    assert ids == ("V01", "V02")
    claims = json.loads(capsys.readouterr().out)["claims"]
    assert [claim["passed"] for claim in claims] == [True, False]
    assert claims[1]["got"] is None
    words["on_claim"](BROKEN)
    assert capsys.readouterr() == ("", "V02 FAILED: a sphere bounces\n")


def test_bench_prints_every_case_with_its_stages_and_takes_sizes_for_devices_alone(room, capsys):
    case = {"case": "bed", "stages": {"contacts": 0.75, "rebuild": 0.25}}
    case["grain_steps_per_s"] = np.float64(1.5e7)
    answer = {"cases": [case], "target": "znver3", "cores": 2, "engine": "taichi 1.7.4"}
    calls = room("benchmarks.cases", "run_benchmarks", answer)
    assert main(["bench"]) == 0
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("bed", "1.5e+07", "contacts 0.75", "rebuild 0.25", "znver3"))
    calls.clear()
    assert main(["bench", "--arch", "cuda", "--quick"]) == 0
    ((_, words),) = calls
    assert words == {"arch": "cuda", "size": "quick"}
    for refused in (["--quick"], ["--large"], ["--arch", "cuda", "--quick", "--large"]):
        assert main(["bench", *refused]) == 2
        assert refused[-1] in capsys.readouterr().err


def test_repose_of_a_photograph_is_measured_within_the_crop(room, capsys, tmp_path):
    image = tmp_path / "heap.png"
    image.touch()
    record = {"name": "repose_angle", "value": 31.0, "sd": 0.4, "unit": "deg", "n": 1}
    record["notes"] = ["left flank only"]
    calls = room("taichi_erosion.measures.photograph", "measure_photograph", record)
    picture = tmp_path / "heap.detected.png"
    room("taichi_erosion.report.pictures", "draw_detection", picture)
    assert main(["measure", "repose", str(image), "--crop", "0,10,200,100", "--background", "dark"]) == 0
    assert calls == [((image,), {"crop": (0, 10, 200, 100), "background": "dark"})]
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["repose_angle = 31.00 ± 0.40 (n = 1) deg", "note: left flank only"]
    assert lines[2] == f"what was detected: {picture}"


def test_devices_and_precisions_on_offer_are_those_of_the_core():
    words = get_type_hints(commands.run)
    offered = {name: set(get_args(get_args(words[name])[0])) for name in ("arch", "precision")}
    known = get_type_hints(Numerics)
    assert offered.pop("arch") == {"auto", *get_args(known["arch"])}
    assert offered == {name: set(get_args(known[name])) for name in offered}


def test_no_colour_is_printed_where_none_is_wanted():
    words = [sys.executable, "-m", "taichi_erosion", "--help"]
    environment = os.environ | {"NO_COLOR": "1", "FORCE_COLOR": "1"}
    printed = subprocess.check_output(words, env=environment, text=True, cwd=Path(__file__).parents[2])
    assert printed
    assert not re.search(r"\x1b\[[0-9;]*3[0-9][0-9;]*m", printed)


def test_sigterm_lets_what_is_open_be_closed(room):
    closed = []

    def simulate(_scene, _options):
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(60.0)
        finally:
            closed.append("recording")

    run_scene(room, simulate)
    with pytest.raises(SystemExit) as ended:
        main(["run", "scene.toml"])
    assert (ended.value.code, closed) == (128 + signal.SIGTERM, ["recording"])


def test_device_of_the_runs_of_a_study_arrives_as_an_option_and_of_designed_ones_as_an_entry(room):
    calls = room("taichi_erosion.evidence.answers.commands", "next_study", BadInput("enough"))
    words = ["--arch", "cuda", "--decomposition", "partitions", "--workers", "2"]
    assert main(["next", "study.toml", *words]) == 2
    (((_, _, options), _),) = calls
    assert (options.arch, options.decomposition, options.workers) == ("cuda", "partitions", 2)
    calls = room("taichi_erosion.campaign.calibration", "calibrate", BadInput("enough"))
    assert main(["doe", "run", "study.toml", "--arch", "cuda", "--workers", "2"]) == 2
    (((path, until, stated, _), words),) = calls
    assert (path, until, words) == (Path("study.toml"), "run", {"force": False})
    assert stated == {"arch": "cuda", "workers": 2}


def test_the_cost_of_a_small_study_is_no_zero():
    cost = {"sentence": "42 runs to make: at most about 45 s on 1 process.", "core_minutes": 0.743}
    assert cost_line("quick", cost).endswith("at most about 45 s on 1 process (0.743 core-minutes)")
    assert cost_line("full", {"sentence": "No run."}) == "cost with --budget full: No run"


def test_effects_lists_the_library_with_what_was_measured_and_those_of_the_closed_form_model(capsys):
    assert main(["effects", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document["effects"]) == set(load_library())
    assert all(page["reference"] for page in document["effects"].values())
    measured = document["effects"]["rolling_resistance"]["measured"]
    assert "angle_of_repose" in {row["observable"] for row in measured}
    assert set(document["closed_form"]) == set(EFFECTS)
    assert "sqrt(1 + 1.21 w^0.68)" in document["closed_form"]["liquid_bridge"]
    assert main(["effects"]) == 0
    scenes, closed_form = capsys.readouterr().out.split("of the closed-form model")
    assert "turbulent_gusts" in scenes
    assert all(f"\n{name} " in closed_form for name in EFFECTS)
    assert "study new --closed-form" in closed_form
    twins = dict(re.findall(r"(\w+) +As (\w+) in scenes", closed_form))
    assert {*EFFECTS, *twins.values()} - {*load_library()} - {*twins} == {"mid_air_collisions"}
