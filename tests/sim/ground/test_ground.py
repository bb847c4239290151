"""Grounds: patches and changes under each pad, names, files, and what is refused."""

import numpy as np

from sim.fleet_ground import PadFriction
from sim.ground.ground import Change, Ground, Patch

PADS = np.array([[0.1, 0.2], [0.1, -0.2]])


def test_patches_act_under_the_pads_that_are_on_them():
    patch = Patch((0.0, 1.0), (0.0, 1.0), 0.2, 0.3)
    upper = Patch((0.5, 1.0), (0.0, 1.0), 0.9, 0.8)
    friction = PadFriction([Ground(0.5, 0.6), Ground(0.5, 0.6, patches=(patch, upper))], PADS)
    assert friction.varies
    at = np.array([[0.2, 0.1], [0.2, 0.1]])
    first, second = friction.surface(0.0, at, np.zeros(2))[..., :2]
    np.testing.assert_allclose(first, [[0.5, 0.6], [0.5, 0.6]])
    np.testing.assert_allclose(second, [[0.2, 0.3], [0.5, 0.6]])  # the right pad is at y = -0.1
    turned = friction.surface(0.0, at, np.full(2, np.pi))[
        1, :, :2
    ]  # now the left pad is at y = -0.1, the right at (0.1, 0.3)
    np.testing.assert_allclose(turned, [[0.5, 0.6], [0.2, 0.3]])
    on_both = friction.surface(0.0, np.add(at, [0.4, 0.0]), np.zeros(2))[1][..., :2]
    np.testing.assert_allclose(on_both[0], [0.9, 0.8])  # the last counts


def test_changes_take_effect_at_their_times_outside_patches():
    patch = Patch((-np.inf, np.inf), (0.0, np.inf), 0.2, 0.3)
    ground = Ground(0.5, 0.6, patches=(patch,), changes=(Change(1.0, 0.7, 0.8), Change(2.0, 0.1, 0.1)))
    friction = PadFriction([ground, Ground()], PADS)
    for time, right in ((0.0, (0.5, 0.6)), (0.99, (0.5, 0.6)), (1.0, (0.7, 0.8)), (2.5, (0.1, 0.1))):
        found = friction.surface(time, np.zeros((2, 2)), np.zeros(2))[..., :2]
        np.testing.assert_allclose(found[0], [(0.2, 0.3), right])
        np.testing.assert_allclose(found[1], [(0.7, 0.778)] * 2)


def test_gravity_points_downhill():
    np.testing.assert_allclose(
        Ground(slope=0.3, uphill=0.0).gravity(9.81), 9.81 * np.array([-np.sin(0.3), 0, -np.cos(0.3)])
    )
    np.testing.assert_allclose(
        Ground(slope=0.3, uphill=np.pi / 2).gravity(9.81)[:2], [0, -9.81 * np.sin(0.3)], atol=1e-12
    )
