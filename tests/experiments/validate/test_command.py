from dataclasses import replace

import numpy as np
import pytest
from command_runs import ran

from experiments.cli import main
from experiments.common.soil import OnSoil
from experiments.validate import checks, command
from experiments.validate.checks import Checks, check_sliding, check_turns
from experiments.validate.measurements import Setup
from experiments.validate.soil import check_straight, slip_uphill
from sim.ground.ground import Ground, load_ground
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK, RobotParameters
from trackslip.errors import TrackslipError
from trackslip.skid_theory import Load, drawbar_curve


@pytest.fixture(scope="module")
def shipped(tmp_path_factory):
    return ran(tmp_path_factory.mktemp("shipped") / "out", "validate", "--seed", "3")


def test_the_shipped_robot(shipped):
    found = shipped.summary["checks"]
    assert len(found) == 11
    assert all(check["holds"] and check["source"] for check in found)
    assert shipped.summary["not_applicable"] == []
    assert "11 checks passed\n" in shipped.printed
    assert (shipped.manifest["seed"], shipped.manifest["robot"]["half_gauge"]) == (3, 0.168)
    assert len(shipped.summary["turns"]["slip"][0]) == 25


def test_bounds_are_shares_of_what_theory_expects(shipped):
    shares = {}
    for check in shipped.summary["checks"]:
        if isinstance(check["bound"], list):
            low, high = check["bound"]
            assert (low + high) / 2 == pytest.approx(check["expected"])
            shares[check["name"].partition(": ")[2]] = (high - low) / 2 / abs(check["expected"])
    for name, share in (
        ("b + D in turns", 0.005),
        ("b + D on the spot", 0.013),
        ("sink on level ground", 0.05),
        ("acceleration sliding downhill", 0.05),
        ("acceleration sliding sideways", 0.05),
    ):
        assert shares[name] == pytest.approx(share, rel=1e-6)


@pytest.mark.slow
def test_a_failed_check_ends_with_1_once_all_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(checks, "GRAVITY", 12.0)
    monkeypatch.setattr(command, "check_energy", lambda *_: None)
    with pytest.raises(SystemExit) as stop:
        main(
            [
                "validate",
                "--out",
                str(tmp_path / "out"),
                "--ground.along",
                "0.6",
                "--ground.slope",
                "0.1",
            ]
        )
    assert stop.value.code == 1
    assert "8 checks passed, 2 failed\n" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Failed: acceleration sliding sideways." in page
    assert "Slope, patches and changes of the ground are left out." in page


@pytest.mark.parametrize(
    ("robot", "skipped"),
    [
        ("husky", []),
        (
            "maxxii",
            [
                "acceleration sliding downhill: too steep for this robot: 35° and 9° to spare > "
                "43°, where"
            ],
        ),
        (
            "com_height = 0.3",
            ["acceleration sliding downhill: ", "acceleration sliding sideways: "],
        ),
    ],
)
def test_every_robot_that_stands_slides_as_coulomb_has_it(tmp_path, robot, skipped):
    if "=" in robot:
        (tmp_path / "robot.toml").write_text(robot + "\n")
        robot = str(tmp_path / "robot.toml")
    found = Checks("robot", Setup(load_parameters(robot)[0], Ground()))
    check_sliding(found)
    assert len(found.done) == 2 - len(skipped)
    for line, start in zip(found.not_applicable, skipped, strict=True):
        assert line.startswith(start)
    assert all(abs(check.measured / check.expected - 1) < 0.01 for check in found.done)


def test_the_value_nearest_to_its_bound_is_shown_and_nan_fails():
    found = Checks("robot", Setup(load_parameters("shipped")[0], Ground()))
    found.add("length", [[1.0, 2.0], [1.1, 2.15]], [0.2, 0.2], "m", "theory")
    found.add("angle", [0.0, np.nan], 0.1, "rad", "theory")
    assert (found.done[0].expected, found.done[0].measured) == (2.0, 2.15)
    assert found.failed == ["angle"]
    assert found.verdict == "1 checks passed, 1 failed"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "ground", "not_applicable"),
    [
        ("husky", "asphalt", []),
        ("maxxii", "stone", ["acceleration sliding downhill"]),
        ("rescue", "gravel", []),
        ("warthog", "firm_sand", []),
        ("shipped", "loose_sand", []),
        ("box", "ice", []),
    ],
)
def test_robots_and_grounds_within_bounds(tmp_path, robot, ground, not_applicable):
    result = ran(tmp_path / "out", "validate", "--robot", robot, "--ground", ground)
    assert [line.partition(":")[0] for line in result.summary["not_applicable"]] == not_applicable
    assert all(check["holds"] for check in result.summary["checks"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "ground", "too_steep"),
    [
        ("shipped", "dry_sand", 0),
        ("shipped", "soft_snow", 2),
        ("rescue", "regolith", 0),
        ("rescue", "soft_snow", 2),
        ("husky", "dry_sand", 0),
        ("warthog", "upland_loam", 0),
    ],
)
def test_robots_on_soft_soil_within_bounds(tmp_path, robot, ground, too_steep):
    result = ran(tmp_path / "out", "validate", "--robot", robot, "--ground", ground)
    found = result.summary["checks"]
    names = [check["name"].partition(": ")[2] for check in found]
    assert names[:2] == ["sinkage on the level", "resistance on the level"]
    assert all(check["holds"] and check["source"] for check in found)
    left_out = result.summary["not_applicable"]
    steep = [line for line in left_out if "tilts by more than 3°" in line]
    assert len(steep) >= too_steep
    others = [line.partition(": ")[0] for line in left_out if line not in steep]
    on_wheels = ["turns on the spot"] if robot in ("husky", "warthog") else []
    assert others == [*on_wheels, "loads, sliding and work"]


def test_straight_ahead_on_sand_is_as_theory_has_it():
    """Other checks on soft soil are those of whole commands, which are slow."""
    found = Checks("robot", Setup(load_parameters("shipped")[0], load_ground("dry_sand")))
    soil = found.setup.ground.soil
    gear = replace(OnSoil(found.setup.parameters, soil, Load()).gear, settlement=SINK)
    check_straight(found, soil, gear, slope=0.1)
    names = [check.what for check in found.done]
    assert names == ["sinkage on the level", "resistance on the level", "slip uphill on 5.7°"]
    assert found.failed == []
    sinkage, resistance, slip = found.done
    level = drawbar_curve(soil, gear, [1e-3])
    assert sinkage.expected == pytest.approx(level.sinkage[0], rel=0.01)
    assert resistance.expected == pytest.approx(level.resistance[0], rel=0.01)
    (left,) = drawbar_curve(soil, gear, [slip.expected], 0.1).pull
    assert left == pytest.approx(0.0, abs=0.001 * gear.weight)


@pytest.mark.parametrize("robot", ["shipped", "husky"])
def test_the_slip_uphill_leaves_nothing_to_pull(robot):
    parameters, _ = load_parameters(robot)
    soil = load_ground("dry_sand").soil
    gear = OnSoil(parameters, soil, Load()).gear
    slope = 0.1
    slip = 0.05
    for _ in range(5):  # Newton's method
        slip = slip_uphill(soil, gear, slope, slip)
    (left,) = drawbar_curve(soil, gear, [slip], slope).pull
    assert left == pytest.approx(0.0, abs=1e-6)  # [N]


def test_a_robot_too_high_to_climb_is_told_its_way_on():
    """Its centre of mass is over the middle sixth of the tracks on level ground only."""
    high = RobotParameters(com_x=-0.04, com_height=0.2)
    with pytest.raises(TrackslipError, match=r"^high: .* lifts uphill on 10°: .*fold.* `key`$"):
        check_turns(Checks("high", Setup(high, Ground(), 1)))
