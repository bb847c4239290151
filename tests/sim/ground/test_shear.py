import numpy as np
import pytest

from sim.ground.shear import LEAST_SHARE, Shear

LENGTH = 0.34  # of a track [m]
POINTS = 10  # along it
PERIOD = 0.01  # [s]
SPEED = 0.12  # of the belts [m/s]
SLIP = 0.2
MODULUS = 0.02  # [m]
X = LENGTH * ((np.arange(POINTS) + 0.5) / POINTS - 0.5)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("lifted", [0.0, 0.01, 0.03, 0.1])
def test_a_lifted_track_shears_from_where_it_touches(direction, lifted):
    """In steady motion straight ahead, j = i (distance behind the entry)."""
    place = np.column_stack([np.tile(X, 2), np.repeat([0.17, -0.17], POINTS)])
    shear = Shear(place, 1, LENGTH, 1, PERIOD, 0.5)
    belt = np.full((1, 2), direction * SPEED)
    for k in range(round(4 * LENGTH / SPEED / PERIOD)):
        travel = direction * (1 - SLIP) * SPEED * PERIOD
        before = np.array([[travel * k], [0.0], [1.0], [0.0]])
        after = before + np.array([[travel], [0.0], [0.0], [0.0]])
        modulus = np.full((1, 2 * POINTS), MODULUS)
        shear.advance(slice(None), before, after, belt, modulus, np.full((1, 2), lifted))

    behind = LENGTH / 2 - lifted - direction * X
    touches = behind > 0
    moved = shear.displacement[0, :POINTS]
    expected = -direction * SLIP * behind[touches]
    np.testing.assert_allclose(moved[touches, 0], expected, rtol=1e-6, atol=1e-12)
    assert (shear.share[0, :POINTS][~touches] == LEAST_SHARE).all()
