"""`trackslip validate`: bounds of the simulator and of tracks on terrain, reports, and the search for limits."""

from pathlib import Path

import numpy as np
import pytest
from command_runs import ran

import models
from experiments.common.formats import significant
from experiments.validate import numerics, theory, turning
from experiments.validate.shear import subjects
from experiments.validate.standing import loads, slide
from experiments.validate.terrain import engine, obstacles, slopes, steps, suite
from experiments.validate.terrain import turning as terrain_turning
from experiments.validate.terrain.subjects import UP, BoxRobot, FromFile
from experiments.validate.terrain.trial import LevelGround, TerrainTrial, limit
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters

SMALLER = {
    turning: {"RATIOS": (0.7, 1.4), "LENGTHS": (1.0,), "CENTRES_OF_MASS": ((0.0, 0.0), (-0.05, 0.1))},
    theory: {"SPEEDS": (0.05, 0.25)},
    numerics: {
        "ROBOTS": 4,
        "DURATION": 6.0,
        "STEPS": (0.002, 0.005, 0.01),
        "REFERENCE_STEP": 0.001,
        "ENERGY_DURATION": 3.0,
    },
}
"""Constants with which the command takes seconds."""
SMALLER_TERRAIN = {
    suite: {"PRESETS": ("accurate",)},
    terrain_turning: {"SLOW": ((-0.04, 0.04), (0.04, 0.08)), "STEADY": 1.0, "WATCH": 0.5},
    slopes: {"FRICTIONS": (0.7,), "ROWS": 3, "ROUNDS": 1, "CLIMBING": 1.5, "TILT": 1.0, "HOLD": 0.5},
    steps: {"ROWS": 3, "ROUNDS": 1},
    obstacles: {"ROBOTS": 2, "DURATION": 1.0, "STAIRS_TIME": 0.5},
    engine: {"TIMED": 0.1, "WARM": 0.0, "ROW_TIME": 0.1},
}
"""The same on terrain."""
PARTS = (
    *("slow", "pivot", "centre of mass off", "climbing", "creep", "highest step", "sideways", "backwards"),
    *("stairs, 99th", "stairs down, largest", "rough ground, largest", "warnings", "fastest", "ten steps"),
    *("batch", "belts", "energy that", "rebound"),
)
"""Fragments of the names of the checks on terrain."""
BOX = Path(models.__file__).parent / "box_robot.toml"


def validated(out, *options, smaller=()):
    """Validate with module constants replaced by those in `smaller`."""
    with pytest.MonkeyPatch.context() as patch:
        for module, constants in dict(smaller).items():
            for name, value in constants.items():
                patch.setattr(module, name, value)
        return ran(out, "validate", *options)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    return validated(tmp_path_factory.mktemp("quick") / "out", "--seed", "3", smaller=SMALLER)


@pytest.fixture(scope="module")
def terrain(tmp_path_factory):
    """A box on terrain."""
    options = ("--terrain", "--robot", str(BOX), "--seed", "2", "--threads", "1")
    return validated(tmp_path_factory.mktemp("terrain") / "out", *options, smaller=SMALLER_TERRAIN)


def failed(found):
    return [check["name"] for check in found["checks"] if not check["holds"]]


def assert_within_bounds(found):
    """Assert what holds for any robot that stands evenly on its tracks."""
    assert failed(found) == []
    assert len(found["checks"]) == 12
    assert all(check["source"] for check in found["checks"])
    assert found["naive_icr_error"]["worst"] > found["naive_icr_error"]["median"] > 0.1
    steps, errors = (np.array([entry[key] for entry in found["timestep"]]) for key in ("dt", "position_error_mm"))
    assert np.all(np.diff(steps) > 0)
    assert np.all(np.diff(errors) > 0)
    assert errors.min() > 0


def assert_report_is_whole(folder, figures):
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg ") == len(list((folder / "figures").glob("*.svg"))) == figures
    assert "nan" not in page


def test_a_validation(quick):
    folder, found, printed, manifest = quick.folder, quick.summary, quick.printed, quick.manifest
    assert_within_bounds(found)
    assert_report_is_whole(folder, 13)
    assert found["turns"] == 2 * 3 * 10
    assert [entry["dt"] for entry in found["timestep"]] == [0.002, 0.005, 0.01]
    assert significant(100 * found["icr_error"]["worst"]) in printed
    assert "12 of 12 checks hold" in printed
    assert (manifest["seed"], manifest["robot"]["half_gauge"], manifest["ground"]["along"]) == (3, 0.168, 0.7)


@pytest.mark.parametrize(
    ("robot", "tips"),
    [
        ("shipped", (False, False)),
        ("husky", (False, False)),
        ("maxxii", (True, False)),
        ("com_height = 0.05", (False, False)),
        ("com_height = 0.3", (True, True)),
    ],
)
def test_every_robot_that_stands_slides_as_coulomb_has_it(tmp_path, robot, tips):
    if "=" in robot:
        (tmp_path / "robot.toml").write_text(robot + "\n")
        robot = str(tmp_path / "robot.toml")
    found = slide(*load_parameters(robot), threads=1)
    assert found.tips.all(axis=1).tolist() == found.tips.any(axis=1).tolist() == list(tips)
    slides = ~found.tips
    np.testing.assert_allclose(found.acceleration[slides], found.expected[slides], rtol=0.01)


def test_loads_are_relative_to_the_weight_even_of_a_robot_that_has_left_the_ground():
    found = loads(*load_parameters("maxxii"), threads=1, default_contact=True)
    assert (found.load.max(axis=1) == 0).any()
    assert np.isfinite(found.load).all()


@pytest.mark.slow
def test_a_robot_that_tips_over_before_it_slides_is_said_to(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text("com_height = 0.3\n")
    result = validated(tmp_path / "out", "--robot", str(file), smaller=SMALLER)
    assert [check["name"] for check in result.summary["checks"] if "friction angle" in check["name"]] == []
    assert result.summary["sliding_acceleration_error"] is None
    assert result.printed.count("the robot tips over before it slides") == 2
    assert_report_is_whole(result.folder, 13)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [None, "half_gauge = 0.25\ncontact_length = 0.5\n"], ids=["shipped", "wide"])
def test_robots_within_bounds(tmp_path, robot):
    file = tmp_path / "robot.toml"
    file.write_text(robot or "")
    result = validated(tmp_path / "out", *(() if robot is None else ("--robot", str(file))))
    found = result.summary
    assert_within_bounds(found)
    assert_report_is_whole(result.folder, 13)
    assert robot or found["turns"] == 1200
    assert [entry["dt"] for entry in found["timestep"]] == [0.0005, 0.001, 0.002, 0.005, 0.01]


def test_every_bound_on_terrain_is_a_check(terrain):
    found = terrain.summary
    assert {check["name"].partition(": ")[0] for check in found["checks"]} == {"box, accurate"}
    for check in found["checks"]:
        low, high = check["bound"] if isinstance(check["bound"], list) else (None, check["bound"])
        low, high = -np.inf if low is None else low, np.inf if high is None else high
        assert check["holds"] == (low <= check["value"] <= high)
        assert check["unit"] in ("1", "m", "m/s", "rad")
    named = [check["name"] for check in found["checks"]]
    assert len(set(named)) == len(named)
    assert [part for part in PARTS if not any(part in name for name in named)] == []
    assert_report_is_whole(terrain.folder, 4)
    assert f"{len(named) - len(failed(found))} of {len(named)} checks hold" in terrain.printed


def test_turns_and_the_engine_hold_their_bounds_even_in_a_glance(terrain):
    """The other checks need the full duration."""
    at_once = ("ICRs", "D alone", "warnings", "numbers", "sliding")
    assert not [name for name in failed(terrain.summary) if name.partition(": ")[2].startswith(at_once)]


@pytest.mark.slow
def test_the_box_and_the_rescue_robot_hold_every_bound(tmp_path):
    found = validated(tmp_path / "out", "--terrain").summary
    robots = {check["name"].partition(": ")[0] for check in found["checks"]}
    assert robots == {"box, accurate", "box, fast", "rescue, accurate", "rescue, fast"}
    assert [name for name in failed(found) if "real time" not in name] == []  # that depends on the computer


@pytest.mark.slow
def test_every_bound_on_ground_that_shears_holds(tmp_path):
    found = validated(tmp_path / "out", "--shear").summary
    assert len(found["checks"]) == 66
    assert [name for name in failed(found) if "processor time" not in name] == []


def test_a_robot_that_is_given_is_measured_instead_of_the_two():
    own = RobotParameters(half_gauge=0.2)
    assert subjects(own, True) == {"robot": own}
    assert list(subjects(own, False)) == ["shipped", "larger"]


@pytest.mark.parametrize("truth", [0.31, 0.5, 0.689])
@pytest.mark.parametrize("rounds", [1, 2, 3])
def test_the_limit_is_found_to_the_last_interval(truth, rounds):
    found = limit(lambda values: values <= truth, 0.0, 1.0, 5, rounds)
    assert abs(found - truth) <= 0.5 * 0.25 / 6 ** (rounds - 1) + 1e-12


@pytest.mark.parametrize("truth", [-0.1, 1.1])
def test_a_limit_elsewhere_is_not_a_number(truth):
    assert np.isnan(limit(lambda values: values <= truth, 0.0, 1.0, 5, 3))


def test_a_centre_of_mass_is_shifted_whatever_link_has_the_mass(tmp_path):
    """The root of a URDF often has none; the base here is turned and has a full matrix of inertia."""
    inertia = '<inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0.01" ixz="0" iyz="0"/>'
    (tmp_path / "r.urdf").write_text(
        f'<robot name="r"><link name="root"/><link name="base"><inertial><mass value="9"/>{inertia}</inertial></link>'
        '<joint name="j" type="fixed"><parent link="root"/><child link="base"/><origin rpy="0 0 1.5"/></joint></robot>'
    )
    file = tmp_path / "r.toml"
    file.write_text('model = "r.urdf"\nhalf_gauge = 0.25\nhull = [[-0.2, 0.0, 0.1], [0.2, 0.0, 0.1]]\n')
    stand = FromFile(str(file)).stand(LevelGround(), "fast", shift=0.05)
    assert stand.view.centre_of_mass == pytest.approx((0.05, 0.0))
    assert stand.model.body_subtreemass[0] == pytest.approx(9)


@pytest.mark.parametrize("subject", [BoxRobot(), FromFile("rescue")], ids=lambda one: one.name)
def test_robots_stand_on_their_tracks_where_theory_has_them(subject):
    stand = subject.stand(LevelGround(), "fast", flippers=UP)
    trial = TerrainTrial(stand, 1, 1)
    trial.drive(np.zeros(2))
    start = trial.position[0].copy()
    trial.advance(2.0)
    sunk, ahead = start - trial.position[0], stand.view.centre_of_mass[0]
    assert 0 < sunk[2] < 5e-3
    assert np.abs(sunk[:2]).max() < 1e-3
    assert trial.leaning()[0] < 1e-3 + np.abs(ahead) / stand.half_length
    assert trial.centre_of_mass()[0] == pytest.approx(trial.position[0, 0] + ahead, abs=1e-3)
    np.testing.assert_allclose(trial.belts.read().load.sum(), stand.model.body_subtreemass[0] * 9.81, rtol=0.01)
