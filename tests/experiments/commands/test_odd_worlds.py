"""Worlds that can be described but not driven in: one line, exit code 2, and nothing is left behind."""

import pytest

SHORT = ("--radii", "1.0", "--speeds", "0.1", "--duration", "4")
STICKY = ("--ground.along", "10", "--ground.across", "10")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--ground", "."), ".: Is a directory"),
        (("--ground", "x" * 5000), "ground = 'xxx"),
        (("--ground.along", "nan"), "ground.along = nan"),
        (("--ground.along", "1e308"), "ground.along = 1e+308: must be at most 10"),
        (("--ground.uphill", "inf"), "ground.uphill = inf: must be a finite number"),
        (("--ground.slope", "0.9", *STICKY), "slope = 0.9: must be less, to park with heading 0 rad: the robot tips"),
        (("--robot", "."), "Is a directory"),
        (("--radius-error", "nan"), "radius_error = nan"),
        (("--drive.motor.voltage", "1e308"), "drive.motor.voltage = 1e+308: must be at most 1e+06"),
        (("--drive.motor.rotor-inertia", "1e300"), "drive.motor.rotor_inertia = 1e+300: must be at most 1e+06"),
        (("--drive.motor.gear", "1e-300"), "drive.motor.gear = 1e-300: must be at least 1e-12"),
        (("--drive.torque-limit", "inf"), "drive.torque_limit = inf"),
    ],
)
def test_options(refused, arguments, message):
    assert message in refused("grid", *SHORT, *arguments)


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        ("--ground", "slope = 0.9", "slope = 0.9: must be less than the friction angle, 0.611 rad"),
        ("--ground", "along = 0x" + "f" * 6000, "must be a number of moderate size"),
        ("--ground", "a = " + "[" * 5000, "not TOML"),
        ("--ground", '"two\\nlines" = 1', "two lines is unknown"),
        ("--robot", "half_gauge = 1e-6", "half_gauge = 1e-06: must be at least 0.001 m"),
        ("--robot", "half_gauge = 0.01", "com_height = 0.12: must be at most 0.0125 m, to stand on tracks"),
        ("--robot", "contact_length = 1e-6", "contact_length = 1e-06: must be at least 0.001 m"),
        ("--robot", "com_x = 0.0566", "com_x = 0.0566: must be between -0.05525 and 0.05525 m"),
        ("--robot", "com_x = 0.04\ncom_y = 0.1", "com_x, com_y = (0.04, 0.1): must be closer to the centre"),
        ("--robot", "mass = 1e300", "mass = 1e+300: must be at most 1000 kg"),
        ("--robot", "[ground]\nbase = 'ice'", "ground: base is unknown"),
        ("--robot", "[ground]\nslope = 0.9", "slope = 0.9: must be less than the friction angle"),
    ],
)
def test_files(refused, tmp_path, option, text, message):
    path = tmp_path / "odd.toml"
    path.write_text(text)
    assert message in refused("grid", *SHORT, option, str(path))


def test_tracking_on_a_steep_slope(refused):
    assert "slope = 0.7: must be less than the friction angle" in refused("track", "--ground.slope", "0.7")


def test_a_robot_too_heavy_for_its_motors_is_told_so(trackslip, tmp_path):
    """It drives, but not as it should: the summary says which run, and for how long."""
    path = tmp_path / "heavy.toml"
    path.write_text("mass = 100\n")
    result = trackslip("grid", "--radii", "1.0", "--speeds", "0.1", "--duration", "6", "--robot", str(path))
    (warning,) = result.summary["warnings"]
    assert warning.startswith("run 'radius=1.0 speed=0.1': a motor is at its limit for ")
    assert warning in result.printed
    assert result.manifest["robot"]["mass"] == 100.0
