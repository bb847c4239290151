"""`trackslip drive`: stored runs, recordings, pages, and policies that drive."""

import json

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
from experiments.drive.course import drive_course
from experiments.drive.world import about_world, driver, make_world
from sim.policy import CrossingPolicy, Network
from sim.settings import from_options
from sim.traverse.config import TraverseConfig
from sim.traverse.policy import OPTIONS
from sim.traverse.task import Crossing
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


@pytest.mark.usefixtures("with_figures")
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


def test_a_policy_drives_as_in_its_environment(tmp_path):
    options = OPTIONS | {"course": "flat"}
    network = Network((np.random.default_rng(0).normal(0, 0.05, (63, 4)),), (np.array([0.0, 0.3, 0.3, -0.3]),))
    policy = CrossingPolicy(network, options)
    policy.save(tmp_path / "policy.npz")
    config = Config(course="flat", policy=tmp_path, duration=3.0, preset="fast")
    world = make_world(config)
    drive = drive_course(world, driver(config, world))
    task = Crossing(from_options(TraverseConfig, options), 1, threads=1)
    task.begin([0], [task.draw(np.random.default_rng(0), {"start_offset": 0.0, "start_heading": 0.0})])
    for _ in range(15):
        task.step(policy.action(task.observation()))
    assert abs(task.world.state.heading[0]) > 0.05
    np.testing.assert_allclose(drive.state.position[-1, :2], task.world.state.position[0, :2], atol=0.02)
    np.testing.assert_allclose(drive.state.heading[-1], task.world.state.heading[0], atol=0.03)
    with pytest.raises(InvalidValueError, match="from 55 inputs to 2"):
        driver(Config(robot="box", policy=tmp_path), make_world(Config(robot="box", course="flat")))


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
