"""The balance on grounds whose loads are known functions of the speeds."""

import numpy as np
import pytest

from sim.motors.balance import Balance, updated_slope
from sim.motors.motor import EvenTorque, Motor
from trackslip.errors import RobotWarning

# at the sprocket: 10 N m at rest, 10 rad/s without a load
MOTOR = Motor(gear=10.0, no_load_speed=100.0, stall_torque=1.0, friction=0.3)
INERTIA = 0.5  # over the step [N m s]
TOLERANCE = 1e-6


def balance(start, goal, law=MOTOR, limit=8.0):
    start = np.atleast_2d(np.asarray(start, float))
    goal = np.atleast_2d(np.asarray(goal, float))
    full = np.full_like(goal, 1.0)
    zero = np.zeros_like(goal)
    return Balance(law, limit * full, INERTIA * full, start, goal, zero, TOLERANCE * full)


def solved(equations, load):
    """The solution on a ground with the loads `load` (A, T) at speeds (A, T)."""
    robots, sprockets = equations.goal.shape
    slope = np.tile(np.eye(sprockets), (robots, 1, 1))
    solution, _ = equations.solve(equations.goal, slope, lambda _, omega: load(omega))
    return solution


def needed(equations, load, omega):
    """Torques (A, T) that reach speeds (A, T) at the end of the step."""
    of_inertia = INERTIA * (omega - equations.start)
    return of_inertia + equations.law.loss(omega) + load(omega)


def coulomb(weight, grip=200.0):
    """Ground that pulls back with up to a weight, and a hill that pulls with a constant."""
    return lambda omega: weight + 2.0 * np.tanh(grip * omega)


def test_a_strong_motor_reaches_its_set_point():
    equations = balance([1.0, -1.0], [2.0, 2.0])
    solution = solved(equations, coulomb(1.0))
    np.testing.assert_array_equal(solution.omega, equations.goal)
    np.testing.assert_allclose(solution.torque, needed(equations, coulomb(1.0), solution.omega))


@pytest.mark.parametrize(
    ("start", "goal", "weight"),
    [(4.0, 9.0, 4.0), (-1.0, 1.0, 9.5), (-6.0, 1.0, 11.0), (3.0, 0.0, -12.0), (11.0, 14.0, -5.0)],
    ids=["uphill", "stalled", "rolled back", "braking", "beyond no-load speed"],
)
def test_a_weak_motor_is_at_the_limit_on_its_side(start, goal, weight):
    equations = balance([start, start], [goal, goal])
    load = coulomb(weight, grip=3.0)
    solution = solved(equations, load)
    assert (solution.omega != equations.goal).all()
    smallest, largest = MOTOR.limits(solution.omega, 8.0)
    expected = np.where(solution.omega < goal, largest, smallest)
    np.testing.assert_allclose(solution.torque, expected)
    np.testing.assert_allclose(solution.torque, needed(equations, load, solution.omega), atol=1e-5)


def test_coupled_sprockets_with_one_weak_motor_are_in_balance():
    """Turning on stiff ground loads the one with what it takes from the other."""
    stiff = np.array([[1000.0, -990.0], [-990.0, 1000.0]])
    equations = balance([2.0, 2.0], [2.0, 3.0], EvenTorque(), limit=[[50.0, 5.0]])
    solution = solved(equations, lambda omega: (omega - 2.0) @ stiff)
    assert solution.omega[0, 0] == 2.0
    assert solution.omega[0, 1] == pytest.approx(2.0 + 5.0 / 1000.5)
    assert solution.torque[0, 1] == 5.0


def test_motors_without_a_limit_are_always_at_their_set_points():
    equations = balance([0.0, 0.0], [1.0, 2.0], EvenTorque(), limit=[[np.inf, 3.0]])
    solution = solved(equations, coulomb(1.0))
    assert solution.omega[0, 0] == 1.0
    assert solution.torque[0, 0] == pytest.approx(INERTIA + 3.0)
    assert solution.omega[0, 1] == 2.0 or solution.torque[0, 1] == 3.0


def test_what_earlier_steps_owe_is_paid_back():
    equations = balance([1.0, 1.0], [1.0, 1.0])
    equations.owed[:] = 0.25
    solution = solved(equations, coulomb(1.0))
    np.testing.assert_allclose(solution.torque, 1.0 + 2.0 + 0.3 - 0.25)


def test_a_ground_without_a_balance_is_reported():
    noise = np.random.default_rng(0)
    equations = balance([0.0], [1.0])
    with pytest.warns(RobotWarning, match="not in balance with the ground: those of 1 robot"):
        solved(equations, lambda omega: 1e3 * noise.standard_normal(omega.shape))


def test_an_update_explains_the_rise_that_was_seen():
    slope = np.array([[[4.0, 1.0], [1.0, 3.0]]])
    moved = np.array([[0.1, -0.2]])
    risen = np.array([[0.7, -0.9]])
    updated = updated_slope(slope, moved, risen, noise=np.full((1, 2), 1e-9))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", updated, moved), risen)
    assert np.linalg.eigvalsh(updated[0]).min() > 0


def test_sliding_belts_leave_a_tenth_of_the_slope():
    slope = np.array([[[4.0]]])
    updated = updated_slope(slope, np.array([[0.1]]), np.array([[0.0]]), np.array([[1e-9]]))
    assert updated[0, 0, 0] == pytest.approx(0.4)


def test_changes_within_the_noise_do_not_count():
    slope = np.array([[[4.0]]])
    updated = updated_slope(slope, np.array([[1e-3]]), np.array([[3e-3]]), np.array([[0.1]]))
    np.testing.assert_array_equal(updated, slope)
