import pytest

from experiments.cli import main
from experiments.predict import Config, predicted_world
from sim.ground.ground import Ground
from trackslip.laws.file import load_laws


def test_the_default_is_the_simulated_robot(robot, trackslip):
    parameters, ground, load = predicted_world(Config())
    assert parameters.half_gauge == robot.geometry.half_gauge
    assert parameters.contact_length == robot.parameters.contact_length
    assert parameters.sprocket_radius == robot.geometry.sprocket_radius
    assert (ground.along, ground.across) == pytest.approx((Ground().along, Ground().across))
    assert load.slope == load.pull == 0
    predicted = load_laws(trackslip("predict").folder, robot.geometry)["icr_radius"]
    assert load_laws()["icr_radius"].offset == pytest.approx(predicted.offset, rel=0.02)
    assert predicted.offset == pytest.approx(0.0445, abs=0.0005)


def test_turns_counted_by_hand_give_the_multiplier(capsys, refused):
    main(
        [
            "predict",
            "--turns",
            "10",
            "--measured",
            "8",
            "--multiplier",
            "1.2",
            "--half-gauge",
            "0.2",
        ]
    )
    first, second = capsys.readouterr().out.splitlines()
    assert first == "wheel_separation_multiplier  1.500, where odometry had 1.2"
    assert second.startswith("D  100.0 mm for half_gauge = 0.2 m")
    assert "turns = 10.0: must be left out without --measured" in refused(
        "predict", "--turns", "10"
    )
    assert "must be from 0.1 to 10" in refused("predict", "--turns", "10", "--measured", "0.01")
    assert "measured = 0.0: must be a finite number other than 0" in refused(
        "predict", "--turns", "10", "--measured", "0"
    )


def test_soft_soil_has_a_drawbar_slip_curve(trackslip):
    result = trackslip("predict", "--ground", "dry_sand")
    summary = result.summary
    assert summary["sinkage"] == pytest.approx(4.974e-3, rel=1e-3)
    assert summary["resistance"] / 245.25 == pytest.approx(0.00697, rel=1e-2)
    drawbar = summary["drawbar"]
    assert max(drawbar["pull"]) == summary["most_pull"]["pull"]
    assert max(drawbar["efficiency"]) == summary["most_efficiency"]["efficiency"]
    # who reads only this page sees what is assumed
    assert "assumed: shear modulus" in result.printed
    assert "4.97 mm" in result.printed


def test_a_pull_beyond_the_most_says_immobilised(trackslip):
    result = trackslip("predict", "--ground", "soft_snow", "--pull", "90")
    assert result.summary["slip_under_load"] is None
    assert "Immobilised" in result.printed


def test_soil_excludes_friction(refused):
    said = "must be left out: the soil of the ground has its own"
    assert said in refused("predict", "--ground", "dry_sand", "--shear", "0.01")


def test_wheels_on_soft_soil_have_two_ruts(trackslip):
    result = trackslip("predict", "--ground", "upland_loam", "--robot", "husky")
    summary = result.summary
    front, rear = result.printed.split("level and without slip")[1].split()[0:3:2]
    assert float(front) < float(rear) == pytest.approx(1e3 * summary["sinkage"], abs=0.01)
    assert summary["most_pull"]["pull"] == pytest.approx(max(summary["drawbar"]["pull"]))
    assert summary["resistance"] < summary["most_pull"]["pull"]


def test_soil_that_does_not_bear_wheels_is_refused(refused):
    said = "must be firm enough to drive on the level"
    assert said in refused("predict", "--ground", "soft_snow", "--robot", "husky")


def by_hand(capsys, line):
    main(["predict", *line.split()])
    return capsys.readouterr().out


def test_turns_to_both_sides_give_a_multiplier_and_both_sides(capsys):
    printed = by_hand(capsys, "--turns 10 -10 --measured 7.9 -8.1")
    assert printed.startswith("wheel_separation_multiplier  1.250, ")
    assert "to the left 1.266, to the right 1.235: they differ by 2.5 %\n" in printed
    assert "radii that differ turn a robot alike to both sides: count again" in printed
    alike = by_hand(capsys, "--turns 10 -10 --measured 8 -8.01")
    assert "they differ by 0.1 %" in alike
    assert "count again" not in alike


@pytest.mark.parametrize(
    ("unit", "turns", "measured"),
    [("deg", 3600, 2880), ("rad", 62.8319, 50.2655), ("turn", 1, 0.8)],
)
def test_turns_may_be_in_degrees_or_radians(capsys, unit, turns, measured):
    printed = by_hand(capsys, f"--turns {turns} --measured {measured} --unit {unit}")
    assert printed.startswith("wheel_separation_multiplier  1.250, ")
    miscounted = 0.1 * 1.25 / (0.8 if unit == "turn" else 8.0)
    assert f"changes the multiplier by {miscounted:.2g}\n" in printed


def test_distances_by_tape_give_the_radii(capsys):
    printed = by_hand(capsys, "--drove 10 --measured 9.8")
    assert "left_wheel_radius_multiplier   0.9800, times that which odometry had" in printed
    assert "ε  -2.00 %, the mean of both sides: distances don't tell them apart" in printed
    both = by_hand(capsys, "--drove 1000 -1000 --measured 980 -960 --unit cm")
    assert "forwards 0.9800, backwards 0.9600: they differ by 2.1 %" in both


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--turns 10 -10 --measured 8 8", "measured = 8.0: must be negative, like -10 of --turns"),
        ("--turns 10 --measured 8 9", "must be as many numbers as --turns has, 1"),
        ("--measured 8", "must be left out without --turns or --drove"),
        ("--drove 1 --turns 1 --measured 1", "drove = 1.0: must be left out with --turns"),
        ("--drove 1 --measured 1 --unit deg", "unit = 'deg': must be m, cm, mm (drove)"),
        ("--drove 1 --measured 1 --half-gauge 0.2", "must be left out with --drove"),
    ],
)
def test_numbers_by_hand_that_contradict_are_refused(refused, line, said):
    assert said in refused("predict", *line.split())


def test_calibrate_takes_pull_tests_only_on_soft_soil(refused):
    refusal = refused("calibrate", "--ground", "dry_sand")
    assert "target = 'published': must be on soft soil a table of a pull test" in refusal
