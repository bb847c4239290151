import numpy as np
import pytest
from drives import GEOMETRY

from trackslip.identification.drive.estimate import DRIVE_LAWS
from trackslip.identification.drive.law_twist import many_twists, twists
from trackslip.slip.families import FAMILIES

VALUES = {
    "none": [],
    "icr": [0.045],
    "icr_radius": [0.045, 0.0066],
    "icr_sides": [0.04, 0.05, 0.01, -0.01],
    "turn_loss": [0.045, 0.0066, 0.3],
    "exponential": [0.1, -1.2, -0.2, -1.5],
}


TABULATED = ("none", "exponential")
_INTERPOLATED = 1e-5  # [m/s]: 0.3 m/s h^2 / 8 f'', h = 2 pi / 4096, f'' < 100 for laws that bend within 0.1 rad


def motions(count=400, seed=0):
    """Twists of turns to both sides that are neither nearly straight nor in place, where laws jump."""
    rng = np.random.default_rng(seed)
    curvature = rng.choice([-1, 1], count) * rng.uniform(0.15, 2.0, count)
    return rng.uniform(0.05, 0.3, count)[:, None] * np.column_stack([np.ones(count), curvature])


@pytest.mark.parametrize("name", DRIVE_LAWS)
def test_twists_are_those_of_the_law_and_twists_undo_its_sprocket_speeds(name):
    law = FAMILIES[name].law(np.array(VALUES[name]), GEOMETRY)
    twist, within = motions(), _INTERPOLATED if name in TABULATED else 1e-12
    omega = law.sprocket_speeds(twist, GEOMETRY)
    found, _ = twists(FAMILIES[name], np.array(VALUES[name]), omega, GEOMETRY)
    np.testing.assert_allclose(found, twist, atol=within)
    np.testing.assert_allclose(found, law.twist(omega, GEOMETRY), atol=within)
    (same,) = many_twists(FAMILIES[name], np.array([VALUES[name]]), omega, GEOMETRY)
    np.testing.assert_array_equal(same, found)


@pytest.mark.parametrize("name", DRIVE_LAWS)
def test_derivatives_are_differences(name):
    family, values = FAMILIES[name], np.array(VALUES[name])
    omega = family.law(values, GEOMETRY).sprocket_speeds(motions(), GEOMETRY)
    _, slope = twists(family, values, omega, GEOMETRY)
    assert slope.shape == (len(omega), 2, len(values))
    for k in range(len(values)):
        step = np.zeros(len(values))
        step[k] = 1e-4
        ahead, behind = (twists(family, values + s, omega, GEOMETRY)[0] for s in (step, -step))
        np.testing.assert_allclose(slope[..., k], (ahead - behind) / 2e-4, atol=5e-5 * max(1, np.abs(slope).max()))


@pytest.mark.parametrize("name", DRIVE_LAWS)
def test_every_sprocket_speed_has_a_finite_twist(name):
    side = np.linspace(-5, 5, 21)
    omega = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    found, slope = twists(FAMILIES[name], np.array(VALUES[name]), omega, GEOMETRY)
    assert np.isfinite(found).all()
    assert np.isfinite(slope).all()
    np.testing.assert_allclose(found[(omega == 0).all(axis=1)], 0.0, atol=1e-12)
