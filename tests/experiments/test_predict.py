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
    assert "measured = 0.0: must be a finite number > 0" in refused(
        "predict", "--turns", "10", "--measured", "0"
    )
