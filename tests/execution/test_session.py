"""Interactive sessions: what is set acts on the grains at once."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from recorded_heaps import read_series

from taichi_erosion.api import prompt
from taichi_erosion.cli import live as terminal
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.core.setup import Motion
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.execution import session as live
from taichi_erosion.execution import stages
from taichi_erosion.execution.observables import wind_patch_of_scene
from taichi_erosion.execution.recorder import present_walls
from taichi_erosion.measures.wind_bed import flux_of_frame
from taichi_erosion.recording.readback import component_rows, read_grains
from taichi_erosion.simulation import contact_network, export_state, friction_velocity, move_surface, snapshot

SCENES = Path(__file__).parents[2] / "scenes"
FEW = ("grains.count=60",)


@pytest.fixture(scope="module")
def opened():
    """A session whose kernels are compiled once, with its state at the beginning."""
    session = live.open_session(SCENES / "column_collapse.toml", FEW)
    live.save_state_as(session, "begin")
    return session


@pytest.fixture
def session(opened):
    """The session at its beginning, as if it had just been opened."""
    live.restore_saved_state(opened, "begin")
    live.save_state_as(opened, "begin")  # of the present buffers: an effect may have been built in
    for kept in (opened.history, opened.callbacks, opened.watched):
        kept.clear()
    for name in set(opened.saved) - {"begin"}:
        del opened.saved[name]
    return opened


def test_a_session_plays_the_scene_to_its_measured_end(session) -> None:
    live.run_for_seconds(session, 0.01)
    live.run_session_steps(session, 3)
    assert session.time == pytest.approx(0.01 + 3 * session.time_step)
    assert live.run_until_rest(session)
    assert session.time >= session.scene.stages[0].duration_min
    column = live.measure_now(session)["column_height"]
    assert live.begin_next_stage(session) == "collapse"
    live.run_for_seconds(session, 0.2)
    assert live.measure_now(session)["pile_height"].value > 0.0
    assert live.measure_now(session)["column_height"] == column, "of the stage that it names"
    with pytest.raises(BadInput, match="last one"):
        live.begin_next_stage(session)


def test_air_without_inertia_settles_at_every_check_of_its_stage(session, monkeypatch) -> None:
    settled = []
    monkeypatch.setattr(stages, "set_steady_air_profile", lambda _, stage, k: settled.append(stage.name))
    live.run_for_seconds(session, 2.0 * session.scene.run.check_interval)
    assert settled == [session.scene.stages[0].name] * 2


def test_gravity_that_is_turned_off_while_running_lets_grains_drift_and_compiles_nothing(session) -> None:
    world = session.sim.world
    live.run_for_seconds(session, 2e-3)
    assert live.change_entry(session, "gravity.magnitude", "0.0").endswith("at once")
    before = snapshot(session.sim, 0)
    live.run_for_seconds(session, 1e-3)
    after = snapshot(session.sim, 0)
    free = (before.contacts == 0) & (after.contacts == 0)
    # a thousandth of a second of gravity would change the fall of a free grain by 1e-2 m/s
    assert np.median(np.abs(after.velocity - before.velocity)[free, 2]) < 1e-4
    assert session.sim.world is world


def test_going_back_restores_the_bits_and_the_parameters(session) -> None:
    live.run_for_seconds(session, 5e-3)
    live.save_state_as(session, "there")
    live.run_for_seconds(session, 5e-3)
    once = snapshot(session.sim, 0).position
    live.change_entry(session, "contact.grain-grain.friction_sliding", "0.0")
    live.restore_saved_state(session, "there")
    assert session.scene.contact["grain-grain"].friction_sliding == 0.55
    live.run_for_seconds(session, 5e-3)
    assert np.array_equal(snapshot(session.sim, 0).position, once)
    with pytest.raises(BadInput, match="ahead of the present"):
        live.run_for_seconds(session, -1.0)


def test_the_history_is_a_script_that_gives_the_same_bits_however_the_run_was_divided(session) -> None:
    friction = "contact.grain-grain.friction_rolling"
    live.run_for_seconds(session, 0.0123)
    live.save_state_as(session, "there")
    live.change_entry(session, "gravity.magnitude", "0.5")  # not in the history of what follows
    live.run_for_seconds(session, 2e-3)
    live.restore_saved_state(session, "there")
    for part in (1e-4, 7.3e-4, 0.0041):
        live.run_for_seconds(session, part)
    prompt.execute_line(session, f"set {friction} 0.3")
    prompt.execute_line(session, "stage")
    prompt.execute_line(session, "step 40")
    once, lines = snapshot(session.sim, 0), list(session.history)
    assert [line.split()[0] for line in lines] == ["run", "set", "stage", "run"]
    live.restore_saved_state(session, "begin")
    assert session.history == []
    for line in lines:
        prompt.execute_line(session, line)
    again = snapshot(session.sim, 0)
    assert np.array_equal(again.position, once.position)
    assert np.array_equal(again.spin, once.spin)
    assert session.history == lines


def test_a_session_that_has_failed_stays_until_it_returns_to_a_saved_state(session) -> None:
    live.save_state_as(session, "good")
    session.state.failure = Failure(Status.OVERLAP, 0.0, 7, 9, 0.31)
    for _ in range(2):
        with pytest.raises(SimulationStopped, match="grain 7 overlaps grain 9"):
            live.run_for_seconds(session, 1e-3)
    assert session.time == 0.0
    live.restore_saved_state(session, "good")
    live.run_for_seconds(session, 1e-3)
    assert session.time == 1e-3


def test_entries_that_are_built_in_are_refused_with_what_may_change(session) -> None:
    with pytest.raises(BadInput, match=r"grains is fixed.*live are contact, gravity"):
        live.change_entry(session, "grains.count", "61")
    with pytest.raises(BadInput, match="friction_sliding"):
        live.change_entry(session, "contact.grain-grain.friction_sliding", "-1.0")
    assert session.scene.contact["grain-grain"].friction_sliding == 0.55


def test_an_effect_can_be_added_strengthened_and_taken_away(session) -> None:
    assert "after building" in live.change_entry(session, "effects.dry_adhesion.strength", "1.0")
    world = session.sim.world
    assert live.change_entry(session, "effects.dry_adhesion.strength", "2.0").endswith("at once")
    assert session.sim.world is world
    assert live.change_entry(session, "effects.dry_adhesion.strength", "0.0").endswith("at once")
    live.run_for_seconds(session, 1e-3)


def test_grains_are_inserted_and_taken_out_and_the_others_keep_their_contacts(session) -> None:
    live.run_for_seconds(session, 0.02)
    prompt.execute_line(session, "insert 3 at 0.0 0.0 0.008")
    live.run_for_seconds(session, 0.05)
    before, (x, y, z) = contact_network(session.sim, 0), snapshot(session.sim, 0).position[61]
    prompt.execute_line(session, "insert 1 at 0 0 0.03")
    for place in (f"{x} {y} {z}", "0 0 0.03", "0 0 -0.01", "0.0135 0 0.02", "0 0 9"):
        with pytest.raises(BadInput, match=r"insert: .* (lies there already|is there|is outside)"):
            prompt.execute_line(session, f"insert 1 at {place}")
    live.undo_latest_change(session)
    prompt.execute_line(session, "remove 5 61")
    after = contact_network(session.sim, 0)
    stays = ~np.isin([before.first, before.second], [5, 61]).any(axis=0)
    assert 0 < len(after.first) < len(before.first)
    assert np.array_equal([after.first, after.second], [before.first[stays], before.second[stays]])
    np.testing.assert_allclose(after.force, before.force[stays], rtol=1e-4, atol=1e-9)
    live.run_for_seconds(session, 0.01)
    now, lines = snapshot(session.sim, 0), list(session.history)
    assert (set(range(63)) - set(now.ident), now.removed) == ({5, 61}, 2)
    commands = "remove 5;remove all;insert 1 through x;insert 1 here;insert 1 at 0 0;insert 100000000"
    for command in commands.split(";"):
        with pytest.raises(BadInput, match=r"no sphere of its own|no inlet|10,000 spheres|usage"):
            prompt.execute_line(session, command)
    for count in (63, 60):
        live.undo_latest_change(session)
        assert len(snapshot(session.sim, 0).ident) == count
    live.restore_saved_state(session, "begin")
    for line in lines:
        prompt.execute_line(session, line)
    assert np.array_equal(snapshot(session.sim, 0).position, now.position)


def test_a_recording_follows_walls_and_holds_one_history(session, tmp_path, capsys) -> None:
    recorder = terminal.open_session_recorder(session, tmp_path / "walls.rrd")
    walls, first = recorder.recorder.walls, recorder.path
    session.callbacks.append(recorder)
    live.run_for_seconds(session, 0.002)
    live.save_state_as(session, "tube stands")
    move_surface(session.sim, 0, "tube", Motion((0.0, 0.0, 0.5), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    live.run_for_seconds(session, 0.006)
    (tube,) = [wall for wall in present_walls(walls, session.sim, 0) if wall.name == "tube"]
    rise = tube.vertices[:, 2] - next(wall for wall in walls if wall.name == "tube").vertices[:, 2]
    np.testing.assert_allclose(rise, 0.5 * 0.006, rtol=1e-6)  # time steps are in single precision
    live.begin_next_stage(session)
    live.run_for_seconds(session, 0.006)
    assert "tube" not in {wall.name for wall in present_walls(walls, session.sim, 0)}
    live.restore_saved_state(session, "tube stands")
    live.run_for_seconds(session, 0.003)
    live.change_entry(session, "record.every", "1e-3")
    for _ in range(3):
        live.run_for_seconds(session, 1.1e-3)
    second = recorder.close(session)
    assert f"{first} ends where the session went back; {second} goes on" in capsys.readouterr().out
    gone = [component_rows(path, "world/walls/tube", "Clear:is_recursive") for path in (first, second)]
    assert list(map(len, gone)) == [1, 0]
    times = [frame.time for frame in read_grains(second)]
    assert times == pytest.approx([0.003, 0.006, 0.007, 0.008, 0.0083], abs=2e-5)


def read_input(session, monkeypatch, tmp_path: Path, lines: list[str], is_terminal: bool) -> Path:
    """Feed lines to the prompt of a session, from a terminal or a pipe; returns its recording."""
    monkeypatch.setattr(terminal.sys, "stdin", io.StringIO("\n".join(lines)))
    monkeypatch.setattr(terminal.sys.stdin, "isatty", lambda: is_terminal, raising=False)
    monkeypatch.setattr("builtins.input", lambda _: lines.pop(0))
    terminal.run_prompt(session, tmp_path / "live.rrd")
    return tmp_path / "live.rrd"


def test_a_piped_session_stops_at_a_mistake_and_keeps_its_recording(session, tmp_path, monkeypatch, capsys):
    orders = ["# begin", "run 0.002s", "status", "set nonsense 1", "run 0.002s"]
    with pytest.raises(BadInput, match="nonsense"):
        read_input(session, monkeypatch, tmp_path, orders, is_terminal=False)
    out = capsys.readouterr().out
    assert "erosion> # begin\nerosion> run 0.002s\n" in out, "commands of a pipe are echoed, comments kept"
    assert "time_s 0.002" in out
    assert session.time == pytest.approx(0.002)
    assert (tmp_path / "live.rrd").exists()


def test_a_session_on_a_terminal_completes_words_and_goes_on(session, tmp_path, monkeypatch, capsys):
    readline = pytest.importorskip("readline")
    record = read_input(session, monkeypatch, tmp_path, ["fly", "run 0.001s", "quit"], is_terminal=True)
    assert record.exists()
    out = capsys.readouterr().out
    assert "'fly' is not a command" in out
    assert "time_s 0.001" in out
    complete = readline.get_completer()
    assert complete("statu", 0) == "status"
    assert complete("contact.grain-grain.friction_rol", 0) == "contact.grain-grain.friction_rolling"


def test_watched_numbers_are_printed_and_kept_for_a_plot(session, capsys, tmp_path, monkeypatch):
    assert prompt.execute_line(session, "watch kinetic_J pile_height") == "watching kinetic_J, pile_height"
    session.callbacks.append(terminal.Sampler())
    monkeypatch.setattr(terminal, "WATCH_INTERVAL", 3600.0)  # s
    live.run_for_seconds(session, 3.0 * session.scene.run.check_interval)
    (line,) = capsys.readouterr().out.splitlines()  # once an interval of wall time
    assert re.fullmatch(r"[\d.e-]+ s  kinetic_J [\d.e-]+ J  pile_height [\d.e-]+ m", line)
    assert len(session.samples) == 3, "what is kept for plots is kept at every check"
    assert prompt.execute_line(session, "watch off") == "watching nothing"
    picture = tmp_path / "curve.png"
    assert prompt.execute_line(session, f"plot kinetic_J {picture}") == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    picture.write_text("mine")
    with pytest.raises(BadInput, match="this program did not write it"):
        prompt.execute_line(session, f"plot kinetic_J {picture}")


def test_changed_entries_are_listed_against_the_file_and_a_saved_state(session) -> None:
    path = "contact.grain-grain.friction_rolling"
    assert "grains.count: " in prompt.execute_line(session, "diff"), "what --set changed is a difference too"
    live.save_state_as(session, "before")
    live.change_entry(session, path, "0.3")
    assert prompt.execute_line(session, "diff before") == f"{path}: 0.12 -> 0.3"
    live.save_state_as(session, "after")
    assert prompt.execute_line(session, "diff before after") == f"{path}: 0.12 -> 0.3"
    assert prompt.execute_line(session, "diff after before") == f"{path}: 0.3 -> 0.12"
    with pytest.raises(BadInput, match="did you mean before"):
        prompt.execute_line(session, "diff befor")


@pytest.mark.parametrize("line", ["run nan", "back to nan", "step \u00b2", "remove \u00b2", "script {}"])
def test_a_line_that_means_nothing_is_told_in_a_sentence(session, line: str, tmp_path: Path) -> None:
    file = tmp_path / "self.txt"
    file.write_text(f"\ufeffstatus # {line}\nscript {file}\n", encoding="utf-8")
    with pytest.raises(BadInput, match=r"not a|usage|line 2: a script runs no other"):
        prompt.execute_line(session, line.format(file))


def test_a_plate_tilts_in_a_session_and_gravity_that_is_set_tilts_with_it() -> None:
    session = live.open_session(SCENES / "incline.toml")
    while not session.scene.stages[session.state.stage].tilt_rate:
        live.begin_next_stage(session)
    for magnitude in (9.81, 3.7):
        live.change_entry(session, "gravity.magnitude", str(magnitude))
        live.run_for_seconds(session, 2.0 * session.scene.run.check_interval)
        gravity = export_state(session.sim)["gravity"][0]
        assert np.linalg.norm(gravity) == pytest.approx(magnitude, rel=1e-6)  # in single precision
        assert np.linalg.norm(gravity[:2]) > 0.0
        live.change_entry(session, "contact.soil-steel.friction_rolling", f"{0.01 * magnitude}")
        assert np.array_equal(export_state(session.sim)["gravity"][0], gravity)


SMALL_PATCH = tuple(
    "grains.count=160 wind.length_d=10 wind.width_d=8 wind.height=0.02 run.check_interval=2e-3 "
    "record.every=2e-3".split()
)


def flux(session) -> float:
    return flux_of_frame(snapshot(session.sim, 0), wind_patch_of_scene(session.scene))


def test_a_search_for_thresholds_goes_on_in_a_session() -> None:
    words = "grains.count=200 effects={} threshold.hold=0.02 threshold.rise=0.5"
    session = live.open_session(SCENES / "wind_threshold.toml", tuple(words.split()))
    live.run_until_rest(session)
    live.begin_next_stage(session)
    live.run_for_seconds(session, 0.02)
    live.save_state_as(session, "ramp")
    with pytest.raises(BadInput, match="friction_velocity is fixed"):
        live.change_entry(session, "wind.friction_velocity", "1.0")
    assert live.run_until_rest(session), "until the search is over"
    found = live.measure_now(session)["threshold_u_star"]
    assert 0.1 < found.value < 1.0
    live.restore_saved_state(session, "ramp")
    assert live.run_until_rest(session)
    assert live.measure_now(session)["threshold_u_star"] == found
    prompt.execute_line(session, "remove 7")
    assert (session.state.search.phase, session.state.search.is_over) == ("ramp", False), "it begins anew"


def test_wind_that_is_raised_while_it_blows_carries_more_and_compiles_nothing(tmp_path: Path) -> None:
    session = live.open_session(SCENES / "saltation.toml", SMALL_PATCH)  # ends the session of the tests above
    recorder = terminal.open_session_recorder(session, tmp_path / "wind.rrd")
    session.callbacks.append(recorder)
    live.change_entry(session, "wind.friction_velocity", "0.05")  # far below the threshold of such sand
    live.run_for_seconds(session, 0.004)
    world, calm = session.sim.world, flux(session)
    assert live.change_entry(session, "wind.friction_velocity", "1.0").endswith("at once")
    assert friction_velocity(session.sim, 0) == pytest.approx(1.0, rel=1e-6)  # kept in single precision
    live.run_for_seconds(session, 0.004)
    assert session.sim.world is world
    # what moves in the calm are grains that still settle, which dies away; the wind pulls on
    assert flux(session) > 3.0 * abs(calm)
    times, recorded = read_series(recorder.close(session), "transport/flux")
    assert recorded[-1] == recorded.max() > 0.0
    assert times[-1] == pytest.approx(0.008, abs=2.0 * session.time_step)
    session.callbacks.clear()
    for name, wind in (("start", 0.6), ("saturate", 0.4123)):
        while session.scene.stages[session.state.stage].name != name:
            live.begin_next_stage(session)
        assert session.scene.wind.friction_velocity == wind, "what its stage orders"
        live.run_for_seconds(session, 0.01)
        live.change_entry(session, "gravity.magnitude", str(10.0 * wind))
        assert session.state.frames == [], "none of another law"
        assert friction_velocity(session.sim, 0) == pytest.approx(wind)
        live.run_for_seconds(session, 2.0 * session.scene.run.check_interval)
        assert len(session.state.frames) <= 2
    assert live.change_entry(session, "wind.friction_velocity", "0").endswith("at once")
    assert friction_velocity(session.sim, 0) == session.scene.friction_velocity_of_stage(3) == 0.0
