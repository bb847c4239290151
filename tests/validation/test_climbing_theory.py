import numpy as np
import pytest
from climbing_theory import SideView, highest_step

pytestmark = pytest.mark.slow
A, C, R, LENGTH = 0.25, 0.12, 0.07, 0.5
"""Centre of mass ahead of the rear wheel and above the ground, the wheels' radius, and their distance [m]."""
TWO_WHEELS = SideView(np.array([(0.0, R, R), (LENGTH, R, R)]), (A, C))


def test_with_much_friction_tipping_over_limits_the_step():
    theta = np.linspace(0, 1.57, 400_001)
    tips_over = R * (1 - np.cos(theta)) + (A - C * np.tan(theta)) * np.sin(theta)
    assert highest_step(TWO_WHEELS, 5.0) == pytest.approx(tips_over.max(), abs=1e-5)


def test_a_low_step_is_climbed_up_to_the_friction_of_a_wheel_on_its_edge():
    """A level robot whose front wheel touches the edge, from moments and forces written out by hand."""
    mu = 0.4

    def push(height):
        angle = np.arccos((R - height) / R)
        force_x, force_z = -np.sin(angle) + mu * np.cos(angle), np.cos(angle) + mu * np.sin(angle)
        load = A / ((LENGTH + R * np.sin(angle)) * force_z - height * force_x)
        return mu * (1 - load * force_z) + load * force_x

    heights = np.linspace(1e-4, R, 2_000)
    limit = heights[np.argmax(np.array([push(h) for h in heights]) < 0)]
    assert highest_step(TWO_WHEELS, mu) == pytest.approx(limit, abs=1e-4)
