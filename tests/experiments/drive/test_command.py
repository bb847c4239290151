import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from rerun.chunk import RrdReader
from rrd import component
from tracked_files import write_robot

import models
import trackslip as library
from experiments.cli import main
from experiments.drive.config import Config
from experiments.drive.course import STOPPED, drive_course
from experiments.drive.page import slip_over_distance
from experiments.drive.world import driver, make_world
from sim.common.settings import from_options
from sim.engine.simulations import States
from sim.policy import Network, Policy
from sim.traverse.config import TraverseConfig
from sim.traverse.policy import OPTIONS
from sim.traverse.task import Crossing
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.trajectory.waypoints import read_waypoints

SHORT = ("--course", "step10", "--preset", "fast", "--speed", "0.5", "--duration", "2")


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    out = tmp_path_factory.mktemp("drive")
    main(["drive", *SHORT, "--out", str(out)])
    return out


def test_a_drive_is_stored_with_units_and_without_nan(stored):
    table = pyarrow.parquet.read_table(stored / "runs.parquet")
    for field in table.schema:
        if field.name != "run":
            assert field.metadata[b"unit"], field.name
            assert field.metadata[b"description"], field.name
            values = table[field.name].to_numpy(zero_copy_only=False)[
                table[field.name].is_valid().to_numpy()
            ]
            assert np.isfinite(values).all(), field.name
    assert table["slip_chassis_left"][0].as_py() is None  # nothing is known at rest
    flippers = ("front_left", "front_right", "rear_left", "rear_right")
    assert {f"angle_{side}_flipper" for side in flippers} < set(table.column_names)
    (log,) = library.load(str(stored))
    assert (log.run, log.time[-1]) == ("drive", pytest.approx(2.0))
    np.testing.assert_allclose(
        log.omega[:, 0], table["belt_chassis_left"].to_numpy() / 0.08, rtol=1e-12
    )
    drive = json.loads((stored / "summary.json").read_text())["drive"]
    assert (drive["outcome"], drive["duration"]) == ("time", pytest.approx(2.0))
    assert 0 < drive["max_penetration"] < 0.02
    assert drive["energy"] == pytest.approx(sum(track["work"] for track in drive["tracks"]))
    assert drive["way"] == pytest.approx(np.hypot(*np.diff([table["x"], table["y"]])).sum())


def test_its_recording_has_the_course_the_robot_and_its_contacts(stored):
    file = stored / "recordings" / "drive.rrd"
    table = pyarrow.parquet.read_table(stored / "runs.parquet")
    time, place = component(file, "/run/robot/chassis", "translation")
    np.testing.assert_allclose(time, table["t"].to_numpy()[::2], atol=1e-6)
    for k, name in enumerate(("x", "y", "z")):
        np.testing.assert_allclose(place[:, k], table[name].to_numpy()[::2], atol=1e-5)
    entities = {chunk.entity_path for chunk in RrdReader(file).stream()}
    assert {
        "/field/ground",
        "/run/contacts/points",
        "/run/contacts/forces",
        "/run/path/driven",
    } <= entities
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
    figures = sorted(file.stem for file in (result.folder / "figures").glob("*.svg"))
    assert figures == ["drive_profile", "drive_slip_over_distance"]
    assert page.count('<div class="zoom">') == 2
    assert page.count("<img ") == 3 == len(list((result.folder / "pictures").glob("*.png")))


def test_a_policy_drives_as_in_its_environment(tmp_path):
    options = OPTIONS | {"course": "flat"}
    network = Network(
        (np.random.default_rng(0).normal(0, 0.05, (63, 4)),), (np.array([0.0, 0.3, 0.3, -0.3]),)
    )
    policy = Policy(network, options)
    policy.save(tmp_path / "policy.npz")
    config = Config(course="flat", policy=tmp_path, duration=3.0, preset="fast")
    world = make_world(config)
    drive = drive_course(world, driver(config, world))
    task = Crossing(from_options(TraverseConfig, options), 1, threads=1)
    task.begin(
        [0], [task.draw(np.random.default_rng(0), {"start_offset": 0.0, "start_heading": 0.0})]
    )
    for _ in range(15):
        task.step(policy.action(task.observation()))
    assert abs(task.world.state.heading[0]) > 0.05
    np.testing.assert_allclose(
        drive.state.position[-1, :2], task.world.state.position[0, :2], atol=0.02
    )
    np.testing.assert_allclose(drive.state.heading[-1], task.world.state.heading[0], atol=0.03)
    with pytest.raises(InvalidValueError, match="from 55 inputs to 2"):
        driver(Config(robot="box", policy=tmp_path), make_world(Config(robot="box", course="flat")))


def without_opengl(*_):
    raise TrackslipError("rendering: no OpenGL works here")


def test_without_opengl_only_asked_for_pictures_are_an_error(trackslip, failing, monkeypatch):
    monkeypatch.setattr("experiments.drive.pictures.Pictures", without_opengl)
    result = trackslip("drive", *SHORT)
    assert "Note: there are no pictures, as rendering: no OpenGL works here." in result.printed
    assert not (result.folder / "pictures").exists()
    assert "no OpenGL works here" in failing("drive", *SHORT, "--pictures", "1")


def driven(**options):
    config = Config(**{"robot": "box", "course": "flat", "preset": "fast", **options})
    world = make_world(config)
    return drive_course(world, driver(config, world))


def test_slip_over_distance_is_weighted_by_the_belts():
    run = driven(course="step10", duration=6.0, speed=0.5)
    left, right = slip_over_distance(run).curves
    assert left.label == "left track"
    assert right.label == "right track"
    of_left, _ = run.sides
    belt = np.abs(run.contact.belt[:, of_left])
    slip = run.contact.slip[:, of_left]

    steps = np.linalg.norm(np.diff(run.state.position[:, :2], axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    last_but_one, last = left.x[-2:]
    assert last < distance[-1] < last + (last - last_but_one)
    ends_of_pieces = (left.x[1:] + left.x[:-1]) / 2
    piece = np.digitize(distance, ends_of_pieces)
    chosen = np.isfinite(slip) & (piece == 30)
    assert left.y[30] == pytest.approx(np.average(slip[chosen], weights=belt[chosen]))


def test_a_robot_that_stays_in_place_has_no_slip_over_distance():
    run = driven(duration=1.0, speed=0.0)
    assert slip_over_distance(run) is None


class TwistedGround:
    """Ground of the height x y / 10."""

    def height(self, x, y):
        return x * y / 10


def test_the_slope_is_that_under_both_tracks():
    """On twisted ground, both tracks point up or down by as much as the ground between them: at
    the heading phi by (y cos(phi) + x sin(phi)) / 10, and the tracks' middle is the hull's.
    """
    flat = driven(duration=0.1)
    x, y, heading = np.random.default_rng(0).uniform(-3.0, 3.0, (3, len(flat.time)))
    zero = 0 * x
    attitude = [np.cos(heading / 2), zero, zero, np.sin(heading / 2)]
    state = States(np.stack([x, y, zero, *attitude], axis=-1), np.zeros((len(x), 6)))
    twisted = replace(flat, course=TwistedGround(), state=state)

    hull = np.array(flat.robot.hull)
    middle = (hull[:, 0].min() + hull[:, 0].max()) / 2
    x_middle = x + middle * np.cos(heading)
    y_middle = y + middle * np.sin(heading)
    gradient = (y_middle * np.cos(heading) + x_middle * np.sin(heading)) / 10
    np.testing.assert_allclose(twisted.slope, np.arctan(gradient), atol=1e-12)


@pytest.mark.slow
def test_a_path_is_followed_to_its_end(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("x,y\n-1,0\n0,0\n1,0.4\n2,-0.2\n3,0\n")
    run = driven(path=path, speed=0.5)
    assert run.outcome == STOPPED
    reference = read_waypoints(path)
    points = reference.pose(np.linspace(0, reference.duration, 2000))[:, :2]
    off = np.hypot(*(run.state.position[:, None, :2] - points).transpose(2, 0, 1)).min(axis=1)
    assert off.max() < 0.06
    np.testing.assert_allclose(run.state.position[-1, :2], [3, 0], atol=0.02)
    assert np.abs(run.command.speed).max() <= 0.5 + 1e-12


@pytest.mark.parametrize(("limit", "climbs"), [(3.2, False), (3.6, True)])
def test_motors_of_the_robot_file_climb_what_their_torque_allows(tmp_path, limit, climbs):
    """25 kg on 20 degrees take 3.36 N m at either sprocket."""
    box = Path(models.__file__).parent / "box_robot.toml"
    text = box.read_text().replace("box_robot.xml", str(box.with_suffix(".xml")))
    (tmp_path / "box.toml").write_text(f"{text}\n[drive]\ntorque_limit = {limit}\n")
    run = driven(robot=str(tmp_path / "box.toml"), course="ramp20", duration=6.0)
    assert (run.state.position[-1, 2] > 0.2) == climbs
    assert (run.contact.belt[-1] > 0.25).all() == climbs
    assert run.contact.traction.max() * 0.08 < 1.1 * limit
