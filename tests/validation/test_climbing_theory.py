import numpy as np
import pytest
from climbing_theory import PITCHES, SideView, highest_step, push_on_step

A, C, R, LENGTH = 0.25, 0.12, 0.07, 0.5
"""Centre of mass ahead of the rear wheel and above the ground, the wheels' radius, and their distance [m]."""
RISING = np.array([(-0.25, 0.07, 0.07), (0.2, 0.07, 0.07), (0.35, 0.16, 0.05), (-0.3, 0.15, 0.06)])
"""A track whose ends rise."""


def two_wheels(ahead=A, height=C, radius=R, length=LENGTH):
    return SideView(np.array([(0.0, radius, radius), (length, radius, radius)]), (ahead, height))


def rising(x=0.0, z=0.13):
    return SideView(RISING, (x, z))


def test_with_much_friction_tipping_over_limits_the_step():
    theta = np.linspace(0, 1.57, 400_001)
    tips_over = R * (1 - np.cos(theta)) + (A - C * np.tan(theta)) * np.sin(theta)
    assert highest_step(two_wheels(), 5.0) == pytest.approx(tips_over.max(), abs=1e-5)


def test_the_robots_frame_does_not_matter():
    moved = SideView(RISING + np.array([0.3, -0.2, 0.0]), (0.3, -0.07))
    assert highest_step(moved, 0.7) == pytest.approx(highest_step(rising(), 0.7), abs=1e-6)
    assert highest_step(SideView(RISING[::-1], (0.0, 0.13)), 0.7) == highest_step(rising(), 0.7)


def test_a_low_step_is_climbed_up_to_the_friction_of_a_wheel_on_its_edge():
    """A level robot whose front wheel touches the edge, from moments and forces written out by hand."""
    mu = 0.4
    view = two_wheels()

    def push(height):
        angle = np.arccos((R - height) / R)
        force_x, force_z = -np.sin(angle) + mu * np.cos(angle), np.cos(angle) + mu * np.sin(angle)
        load = A / ((LENGTH + R * np.sin(angle)) * force_z - height * force_x)
        return mu * (1 - load * force_z) + load * force_x

    heights = np.linspace(1e-4, R, 2_000)
    limit = heights[np.argmax(np.array([push(h) for h in heights]) < 0)]
    assert highest_step(view, mu) == pytest.approx(limit, abs=1e-4)


def brute_force(view, mu, height, pitch):
    """Push and whether the robot tips over, of a track drawn point by point; the balance is solved as a system."""
    around = np.linspace(0, 2 * np.pi, 4_000, endpoint=False)
    directions = np.column_stack([np.cos(around), np.sin(around)])
    rim = (view.wheels[:, None, :2] + view.wheels[:, None, 2:] * directions).reshape(-1, 2)
    support = (rim @ directions[::4].T).max(axis=0)
    turn = np.array([[np.cos(pitch), np.sin(pitch)], [-np.sin(pitch), np.cos(pitch)]])
    rim, outward = rim @ turn, directions[::4] @ turn
    rear = rim[np.argmin(rim[:, 1])]
    centre = view.centre_of_mass @ turn - rear
    support = support - outward @ rear
    # the hull is where every support line allows it; slide up to the step's height and then as far ahead as possible
    heights = np.linspace(0, height, 1001)
    forwards = outward[:, 0] > 1e-9
    reach = ((support[forwards] - heights[:, None] * outward[forwards, 1]) / outward[forwards, 0]).min(axis=1)
    k = int(np.argmax(reach))
    edge, touched = reach[k], heights[k]
    active = np.argmin((support[forwards] - touched * outward[forwards, 1]) / outward[forwards, 0])
    normal = -outward[forwards][active] if k == len(heights) - 1 else np.array([-1.0, 0.0])
    along = np.array([normal[1], -normal[0]])
    # unknown: rear load, front load, push that is missing; forwards, upwards, moment about the rear contact
    force = normal + mu * along
    system = np.array([[mu, force[0], -1], [1, force[1], 0], [0, edge * force[1] - touched * force[0], 0]])
    rear_load, front_load, push = np.linalg.solve(system, [0, 1, centre[0]])
    return push if rear_load > 0 else front_load * force[0], centre[0] >= edge


@pytest.mark.parametrize("view", [two_wheels(), rising(0.05, 0.2)])
def test_push_on_a_step_is_that_of_a_track_drawn_point_by_point(view):
    push, over = push_on_step(view, 0.8, np.array([0.1]))
    for k in range(5, 200, 45):
        expected, tips = brute_force(view, 0.8, 0.1, PITCHES[k])
        assert over[0, k] == tips
        if not tips:
            assert push[0, k] == pytest.approx(expected, abs=0.01)
