import numpy as np
import pytest

from sim.motors.servo import FlipperServo, Servo

COMMAND = np.array([[0.4, -9.0], [0.0, 0.2]])
LIMITED = np.array([[0.4, -0.5], [0.0, 0.2]])
"""The command within a top speed of 0.5."""


def commanded(period):
    servo = Servo(2, lag=0.1, period=period, top_speed=0.5)
    servo.command(COMMAND)
    return servo


def test_a_speed_follows_its_lag_up_to_the_top_speed():
    servo = commanded(0.05)
    mean = servo.advance()
    np.testing.assert_allclose(servo.speed, LIMITED * -np.expm1(-0.5), atol=1e-12)
    assert mean[0, 0] == pytest.approx(0.4 * (1 + np.expm1(-0.5) / 0.5))


def test_the_mean_speed_of_a_period_is_that_of_its_parts():
    fine = commanded(0.001)
    parts = [fine.advance() for _ in range(50)]
    np.testing.assert_allclose(commanded(0.05).advance(), np.mean(parts, axis=0), atol=1e-12)


def test_a_servo_continues_from_the_speed_a_weak_motor_reached():
    servo = commanded(0.05)
    servo.advance()
    servo.correct(np.array([[True, False], [False, False]]), np.full((2, 2), 0.1))
    assert servo.speed[0, 0] == pytest.approx(0.1)
    assert servo.speed[0, 1] == pytest.approx(-0.5 * -np.expm1(-0.5))
    servo.advance()
    assert servo.speed[0, 0] == pytest.approx(0.4 - 0.3 * np.exp(-0.5))


def test_robots_begun_anew_have_lags_of_their_own():
    servo = commanded(0.05)
    servo.begin(np.array([1]), [0.2])
    servo.command(COMMAND)
    servo.advance()
    np.testing.assert_allclose(servo.speed[:, 1], LIMITED[:, 1] * -np.expm1([-0.5, -0.25]))


def test_flippers_turn_at_a_limited_rate():
    servo = FlipperServo(2, 1)
    servo.command(np.array([[0.5], [-0.02]]))
    servo.advance(0.05)
    np.testing.assert_allclose(servo.angle, [[1.5 * 0.05], [-0.02]])
