import numpy as np
import pytest

from sim.motors.motor import Drive, EvenTorque, Motor, tireless
from trackslip.errors import InvalidValueError

# at the sprocket: 10 N m at rest, 10 rad/s without a load
MOTOR = Motor(gear=10.0, no_load_speed=100.0, stall_torque=1.0, friction=0.3)


@pytest.mark.parametrize(
    ("omega", "smallest", "largest"),
    [
        (0.0, -4.0, 4.0),  # the current
        (7.0, -4.0, 3.0),  # the torque-speed line
        (12.0, -4.0, -2.0),  # beyond the no-load speed, it can only brake
        (50.0, -4.0, -4.0),  # and takes at least its largest current
        (-7.0, -3.0, 4.0),  # backwards, all signs change
        (-50.0, 4.0, 4.0),
    ],
)
def test_limits_are_the_current_and_the_torque_speed_line(omega, smallest, largest):
    limits = Drive(torque_limit=4.0, motor=MOTOR).limits(np.array(omega))
    np.testing.assert_allclose(limits, (smallest, largest))


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("lag", 0.0, "> 0"),
        ("lag", 1.1, "1"),
        ("top_speed", 0.0, "> 0"),
        ("top_speed", 10.1, "10"),
        ("torque_limit", -1.0, "> 0"),
        ("torque_limit", 0.3, "more than motor.friction = 0.3 N m"),
        ("encoder_counts", 0, "> 0"),
        ("period", 0.0, "> 0"),
        ("period", np.nan, "> 0"),
    ],
)
def test_drives_that_cannot_be_are_refused(field, value, allowed):
    with pytest.raises(InvalidValueError) as refused:
        Drive(motor=MOTOR, **{field: value})
    assert refused.value.field == field
    assert allowed in refused.value.allowed


def test_against_its_motion_a_motor_is_stronger_than_at_rest():
    """At full voltage, the back-EMF then adds to the voltage."""
    _, largest = MOTOR.limits(np.array([0.0, -2.0, -5.0]), 100.0)
    np.testing.assert_allclose(largest, [10.0, 12.0, 15.0])


def test_friction_is_against_the_motion():
    np.testing.assert_allclose(MOTOR.loss(np.array([-1.0, 0.0, 1.0])), [-0.3, 0.0, 0.3])


def test_what_reaches_a_belt_is_less_by_the_friction():
    drive = Drive(torque_limit=4.0, motor=MOTOR)
    assert drive.strength(2.0) == pytest.approx(3.7)
    assert drive.strength(-8.0) == pytest.approx(1.7)


def test_power_is_that_of_the_shaft_and_of_the_winding():
    torque_per_current = MOTOR.gear * MOTOR.torque_constant
    current = 4.0 / torque_per_current
    shaft = 4.0 * 2.0
    winding = MOTOR.resistance * current**2
    assert MOTOR.power(np.array(4.0), np.array(2.0)) == pytest.approx(shaft + winding)
    # at full voltage and the torque of the line, the battery gives voltage times current
    _, torque = MOTOR.limits(np.array(3.0), np.inf)
    current = torque / torque_per_current
    assert MOTOR.power(torque, np.array(3.0)) == pytest.approx(MOTOR.voltage * current)


def test_a_tireless_drive_takes_the_power_of_its_shaft():
    drive = tireless()
    omega = np.array(9.0)
    _, largest = drive.limits(omega)
    assert largest == 1e6
    assert drive.motor.loss(omega) == 0.0
    assert drive.motor.power(np.array(50.0), omega) == pytest.approx(50.0 * 9.0, rel=1e-4)


def test_even_torque_is_the_limit_at_any_speed():
    smallest, largest = EvenTorque().limits(np.array([-9.0, 0.0, 9.0]), 2.0)
    np.testing.assert_array_equal(smallest, [-2.0, -2.0, -2.0])
    np.testing.assert_array_equal(largest, [2.0, 2.0, 2.0])
