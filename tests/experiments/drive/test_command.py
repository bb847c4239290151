"""`trackslip drive`: stored runs, recordings, pages, and driving by keyboard."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pyarrow.parquet
import pytest
from matplotlib.image import imread
from rerun.chunk import RrdReader
from rrd import component, verify
from tracked_files import write_robot

import trackslip as library
from experiments.cli import main
from experiments.drive.config import Config
from experiments.drive.teleop import Keyboard
from experiments.drive.world import about_world, make_world
from trackslip.errors import InvalidValueError

SHORT = ("--course", "step10", "--preset", "fast", "--speed", "0.5", "--duration", "2")


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A drive of the rescue robot over a step."""
    out = tmp_path_factory.mktemp("drive")
    main(["drive", *SHORT, "--out", str(out)])
    return out


def test_a_drive_is_stored_with_units_and_without_nan(stored):
    table = pyarrow.parquet.read_table(stored / "runs.parquet")
    for field in table.schema:
        if field.name != "run":
            assert field.metadata[b"unit"], field.name
            assert field.metadata[b"description"], field.name
            values = table[field.name].to_numpy(zero_copy_only=False)[table[field.name].is_valid().to_numpy()]
            assert np.isfinite(values).all(), field.name
    assert table["slip_chassis_left"][0].as_py() is None  # nothing is known at rest
    flippers = ("front_left", "front_right", "rear_left", "rear_right")
    assert {f"angle_{side}_flipper" for side in flippers} < set(table.column_names)
    (log,) = library.load(str(stored))
    assert (log.run, log.time[-1]) == ("drive", pytest.approx(2.0))
    np.testing.assert_allclose(log.omega[:, 0], table["belt_chassis_left"].to_numpy() / 0.08, rtol=1e-12)
    drive = json.loads((stored / "summary.json").read_text())["drive"]
    assert (drive["outcome"], drive["duration"]) == ("time", pytest.approx(2.0))
    assert 0 < drive["max_penetration"] < 0.02
    assert drive["energy"] == pytest.approx(sum(track["work"] for track in drive["tracks"]))
    assert drive["way"] == pytest.approx(np.hypot(*np.diff([table["x"], table["y"]])).sum())


def test_its_recording_has_the_course_the_robot_and_its_contacts(stored):
    file = stored / "recordings" / "drive.rrd"
    verify(file)
    table = pyarrow.parquet.read_table(stored / "runs.parquet")
    time, place = component(file, "/run/robot/chassis", "translation")
    np.testing.assert_allclose(time, table["t"].to_numpy()[::2], atol=1e-6)
    for k, name in enumerate(("x", "y", "z")):
        np.testing.assert_allclose(place[:, k], table[name].to_numpy()[::2], atol=1e-5)
    entities = {chunk.entity_path for chunk in RrdReader(file).stream()}
    assert {"/field/ground", "/run/contacts/points", "/run/contacts/forces", "/run/path/driven"} <= entities
    for kind in ("boxes", "wheels"):
        _, place = component(file, f"/run/robot/chassis/chassis_left/{kind}", "centers")
        assert np.ptp(place.reshape(len(time), -1, 3), axis=0).max() > 0.01
    assert component(file, "/run/slip/tracks", "scalars")[1].shape[1] == 6


def test_a_users_robot_and_course_with_a_report(trackslip, tmp_path):
    course = tmp_path / "course.toml"
    course.write_text('friction = 0.9\n[[pieces]]\nkind = "ramp"\nangle = 0.2\nlength = 1.0\n')
    result = trackslip(
        *("drive", "--robot", str(write_robot(tmp_path)), "--course", str(course)),
        *("--preset", "fast", "--speed", "0.6", "--flippers", "up"),
    )
    assert result.summary["drive"]["outcome"] == "reached"
    assert "It crossed the course after" in result.printed
    assert "arm track" in result.printed
    page = (result.folder / "report.html").read_text()
    assert "<h2>It crossed the course after" in page
    assert page.count("<svg ") == len(list((result.folder / "figures").glob("*.svg"))) == 2


@pytest.mark.slow
def test_pictures_follow_the_robot(trackslip):
    result = trackslip("drive", "--course", "flat", "--robot", "box", "--duration", "0.6", "--pictures", "2")
    first, last = (imread(file) for file in sorted((result.folder / "pictures").glob("*.png")))
    assert first.shape[:2] == (540, 960)
    assert np.abs(last - first).max() > 0.2


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="there is always a display")
def test_a_display_that_is_not_there_is_named_in_one_line(refused, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert "needs a display" in refused("drive", "--teleop", "--course", "flat")


def test_keys():
    up, left, space, home, page_down = 265, 263, 32, 268, 267
    world = make_world(Config(course="flat"))
    keyboard = Keyboard(world)
    for key in (up, up, up, left):
        keyboard.press(key)
    np.testing.assert_allclose(keyboard.twist, [0.15, 0.1])
    for _ in range(50):
        keyboard.press(up)
    assert keyboard.twist[0] == 0.6
    keyboard.press(space)
    np.testing.assert_allclose(keyboard.twist, [0.0, 0.0])
    assert keyboard.angles is None
    keyboard.press(home)
    keyboard.press(page_down)
    np.testing.assert_allclose(keyboard.angles, world.servo.angle + 0.1 * np.array([1, 1, -1, -1]))


@pytest.mark.slow
def test_teleop_on_a_virtual_display(tmp_path):
    if shutil.which("xvfb-run") is None:
        pytest.skip("there is no xvfb-run")
    own = [sys.executable, "-m", "experiments", "drive", "--teleop", "--robot", "box", "--course", "flat"]
    command = ["xvfb-run", "-a", "-s", "-screen 0 640x480x24", *own, "--duration", "1", "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "arrow keys" in done.stdout
    drive = json.loads((tmp_path / "out" / "summary.json").read_text())["drive"]
    assert drive["outcome"] == "time"
    assert drive["duration"] == pytest.approx(1.0)


def test_a_drawn_course_follows_from_the_seed_that_is_stored():
    world = make_world(Config(course="rails", seed=7))
    assert about_world(world)["seed"] == 7
    assert make_world(Config(course="rails", seed=7)).course == world.course
    with pytest.raises(InvalidValueError, match=r"course = 'lava': must be one of .*step10, steps_up, .*\.toml"):
        make_world(Config(course="lava"))


def test_a_check_prints_what_is_known_of_a_robot_and_fails_if_something_is_wrong(capsys, tmp_path):
    main(["drive", "--check", "--robot", "box"])
    assert "mass: 25 kg, +0.000 m ahead" in capsys.readouterr().out
    low = write_robot(tmp_path).with_name("low.toml")
    low.write_text(write_robot(tmp_path).read_text().replace("0.1, 0.1]", "0.3, 0.1]"))
    with pytest.raises(SystemExit, match="2"):
        main(["drive", "--check", "--robot", str(low)])
    printed = capsys.readouterr()
    assert "error: " in printed.out
    assert "above the tracks' lowest point" in printed.out
    assert printed.err.endswith("1 error, see above\n")
