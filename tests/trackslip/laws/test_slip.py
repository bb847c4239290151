import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackslip.kinematics import RobotGeometry, body_twist, track_speeds
from trackslip.laws.base import NoSlip
from trackslip.laws.exponential import PUBLISHED, Exponential, ExponentialSpeed
from trackslip.laws.families import FAMILIES
from trackslip.laws.icr import ConstantIcr, DiffDrive, IcrSides
from trackslip.laws.turn_loss import Centrifugal, TurnLoss, TurnLossSides
from trackslip.online.compensation import known_law

GEOMETRY = RobotGeometry(0.168, 0.06)
ICR = ConstantIcr(0.045, 0.168)
ICR_RADIUS = ConstantIcr(0.045, 0.168, 0.0067)
LOSS = TurnLoss(0.045, 0.168, 0.0067, 0.3)
LAWS = [NoSlip(), PUBLISHED, ICR, ICR_RADIUS, LOSS]
SPEED = ExponentialSpeed(0.07, -0.68, -0.15, -0.63, 0.1, -0.2)
ICR_SIDES = IcrSides(0.04, 0.05, 0.005, 0.012, 0.168)
RADII = DiffDrive(0.045, 0.005, -0.012, 0.168)
LOSS_SIDES = TurnLossSides(0.045, 0.005, -0.012, 0.168, 0.3)
curvatures = st.floats(-4, 4)


def there_and_back(law, twist):
    """The twist at the sprocket speeds for a twist."""
    omega = law.sprocket_speeds(twist, GEOMETRY)
    return law.twist(omega, GEOMETRY)


@pytest.mark.parametrize("law", LAWS)
@given(kappa=curvatures)
def test_right_turns_mirror_left_turns(law, kappa):
    np.testing.assert_allclose(law(-kappa), law(kappa)[::-1], atol=1e-12)


def test_published_law_is_eq_11():
    radius = np.array([0.62, 1.34, 2.05, 2.68, 3.12])
    inner, outer = PUBLISHED(1 / radius).T
    np.testing.assert_allclose(outer, 0.07 * np.exp(-0.68 * radius))
    np.testing.assert_allclose(inner, -0.15 * np.exp(-0.63 * radius))
    np.testing.assert_array_equal(PUBLISHED(0.0), [0.0, 0.0])
    np.testing.assert_allclose(PUBLISHED(np.inf), [-0.15, 0.07])


def test_constant_icr_is_the_hyperbola():
    b = 0.168
    d = 0.045
    radius = np.array([0.6, 1.3, 3.0, 100.0])
    left, right = ConstantIcr(d, b)(1 / radius).T
    np.testing.assert_allclose(right, d / (radius + b + d), rtol=1e-9)
    np.testing.assert_allclose(left, -d / (radius - b - d), rtol=1e-9)
    np.testing.assert_allclose(ConstantIcr(d, b, 0.01)(0.0), [-0.01, -0.01])


def test_the_effective_half_gauge_is_b_plus_d():
    robots = ConstantIcr(np.array([0.0, 0.09]), 0.168, np.array([0.0, 0.05]))
    cases = [
        (NoSlip(), 0.168),
        (ICR_RADIUS, 0.213),
        (ICR_SIDES, 0.213),
        (ConstantIcr(0.9, 0.168), 1.068),
        (robots, 0.213),
    ]
    for law, expected in cases:
        assert law.effective_half_gauge(GEOMETRY) == pytest.approx(expected, abs=1e-4)
    # of the paper's law: belts of an inner and an outer track at this radius
    radius = 4 * 0.168
    inner_slip, outer_slip = PUBLISHED(1 / radius)
    inner = (radius - 0.168) / (1 - inner_slip)
    outer = (radius + 0.168) / (1 - outer_slip)
    expected = radius * (outer - inner) / (outer + inner)
    assert PUBLISHED.effective_half_gauge(GEOMETRY) == pytest.approx(expected)


@pytest.mark.parametrize("law", LAWS)
@given(v=st.floats(-0.3, 0.3), kappa=curvatures)
def test_sprocket_speeds_undo_the_slip(law, v, kappa):
    twist = np.array([v, v * kappa])
    omega = law.sprocket_speeds(twist, GEOMETRY)
    np.testing.assert_allclose(body_twist(omega, law(kappa), GEOMETRY), twist, atol=1e-9)


@pytest.mark.parametrize("law", [*LAWS, SPEED, RADII, ICR_SIDES, LOSS_SIDES])
@given(
    v=st.floats(0.05, 0.3),
    radius=st.floats(0.5, 1000.0),
    left=st.booleans(),
    backwards=st.booleans(),
)
def test_a_twist_is_found_from_its_sprocket_speeds(law, v, radius, left, backwards):
    kappa = (1 if left else -1) / radius
    direction = -1 if backwards else 1
    twist = direction * np.array([v, v * kappa])
    np.testing.assert_allclose(there_and_back(law, twist), twist, atol=1e-9)


@pytest.mark.parametrize("law", [NoSlip(), ICR_RADIUS, RADII, ICR_SIDES, LOSS, LOSS_SIDES])
def test_turning_in_place_and_standing_are_twists_too(law):
    for twist in ([0.0, 0.5], [0.0, -0.5], [0.0, 0.0]):
        np.testing.assert_allclose(there_and_back(law, twist), twist, atol=1e-12)


@given(v=st.floats(-3, 3), w=st.floats(-9, 9), loss=st.floats(-7.9, 0.99))
def test_the_belts_of_a_robot_that_loses_speed_in_turns(v, w, loss):
    """Their mean speed is the only real root of a cubic, which NumPy finds as an eigenvalue."""
    law = TurnLoss(0.045, 0.168, 0.0067, loss)
    omega = law.sprocket_speeds([v, w], GEOMETRY)
    np.testing.assert_allclose(law.twist(omega, GEOMETRY), [v, w], rtol=1e-12, atol=1e-14)
    left, right = omega * 0.06 * 1.0067
    d = (0.168 + 0.045) * w
    assert (right - left) / 2 == pytest.approx(d, abs=1e-14)
    roots = np.roots([1, -v, (1 - loss) * d**2, -v * d**2])
    distance = np.abs(roots - (right + left) / 2).min()
    assert distance == pytest.approx(0, abs=1e-4)  # of a triple root, as with w = 0


@given(v=st.floats(-5, 5), w=st.floats(-9, 9), loss=st.floats(-1, 0.99), slip=st.floats(0, 10))
def test_a_skidding_robot_keeps_its_curve(v, w, loss, slip):
    law = known_law(Centrifugal(0.045, 0.168, 0.0067, loss, slip)).law()
    omega = law.sprocket_speeds([v, w], GEOMETRY)
    np.testing.assert_allclose(law.twist(omega, GEOMETRY), [v, w], rtol=1e-11, atol=1e-14)
    slow = TurnLoss(0.045, 0.168, 0.0067, loss)
    grown = (1 + slip * abs(v * w)) * np.array([v, w])
    np.testing.assert_allclose(slow.twist(omega, GEOMETRY), grown, rtol=1e-11, atol=1e-14)
    np.testing.assert_array_equal(law(1.5), slow(1.5))
    if (np.abs(omega) > 1e-3).all():
        by_slip = body_twist(omega, law.slip([v, w]), GEOMETRY)
        np.testing.assert_allclose(by_slip, [v, w], rtol=1e-9, atol=1e-9)


@given(v=st.floats(-3, 3), w=st.floats(-9, 9))
def test_a_differential_drive_has_wheels_at_its_icrs(v, w):
    """Each wheel, of its own radius, rolls at half the distance of the ICRs from the middle."""
    left, right = RADII.sprocket_speeds([v, w], GEOMETRY)
    left_belt = 0.06 * 1.005 * left
    right_belt = 0.06 * 0.988 * right
    assert left_belt == pytest.approx(v - 0.213 * w, abs=1e-12)
    assert right_belt == pytest.approx(v + 0.213 * w, abs=1e-12)


def test_special_cases_agree():
    kappa = np.linspace(-2, 2, 41)
    same = IcrSides(0.045, 0.045, 0.01, 0.01, 0.168)
    np.testing.assert_allclose(same(kappa), ConstantIcr(0.045, 0.168, 0.01)(kappa), atol=1e-12)
    lossless = TurnLoss(0.045, 0.168, 0.0067)
    np.testing.assert_allclose(lossless(kappa), ICR_RADIUS(kappa), atol=1e-9)

    twist = np.random.default_rng(0).uniform(-3, 3, (50, 2))
    omega = TurnLoss(0.045, 0.168, 0.01, 0.3).sprocket_speeds(twist, GEOMETRY)
    for equal in (
        TurnLossSides(0.045, 0.01, 0.01, 0.168, 0.3),
        Centrifugal(0.045, 0.168, 0.01, 0.3, 0.0),
    ):
        np.testing.assert_array_equal(equal.sprocket_speeds(twist, GEOMETRY), omega)
        np.testing.assert_allclose(equal.twist(omega, GEOMETRY), twist, rtol=1e-12)

    # on a radius of 1 m, at speeds that differ by 0.2 m/s
    slow, fast = SPEED.slip([[0.1, 0.1], [0.3, 0.3]])
    by_speed = np.array([-0.2 * np.exp(-0.63), 0.1 * np.exp(-0.68)])
    np.testing.assert_allclose(fast - slow, by_speed * 0.2)
    np.testing.assert_allclose(SPEED(1.0), PUBLISHED(1.0))


@pytest.mark.parametrize("law", [PUBLISHED, SPEED])
@pytest.mark.parametrize("radius", [0.02, 0.05, 0.14])
def test_turns_with_opposed_belts_have_a_radius(law, radius):
    twist = 0.5 * np.array([radius, 1.0])
    np.testing.assert_allclose(there_and_back(law, twist), twist, atol=1e-9)


@pytest.mark.parametrize("law", [PUBLISHED, SPEED])
@given(w=st.floats(0.01, 3.0), left=st.booleans(), share=st.floats(0, 1))
def test_slips_within_the_jump_turn_in_place(law, w, left, share):
    twist = np.array([0.0, w if left else -w])
    slip = share * law(np.inf) + (1 - share) * law(-np.inf)
    belts = track_speeds(twist, GEOMETRY.half_gauge) / (1 - slip)
    found = law.twist(belts / GEOMETRY.sprocket_radius, GEOMETRY)
    np.testing.assert_allclose(found, twist, rtol=1e-12, atol=0)


@pytest.mark.parametrize(
    ("kind", "ends"),
    [
        (Exponential, [(0, 0.3), (-2, -0.1), (-0.5, 0), (-2, -0.1)]),
        (lambda d, e: ConstantIcr(d, 0.168, e), [(0, 0.1), (-0.1, 0.1)]),
        (lambda d, g: TurnLoss(d, 0.168, 0.0, g), [(0, 0.1), (-0.5, 0.5)]),
        (lambda d, e, g: TurnLossSides(d, e, -e, 0.168, g), [(0, 0.1), (-0.1, 0.1), (-0.5, 0.5)]),
        (lambda d, g, k: Centrifugal(d, 0.168, 0.0, g, k), [(0, 0.1), (-0.5, 0.5), (0, 5)]),
    ],
)
def test_many_laws_at_once_are_each_of_them(kind, ends):
    """Turns in place, which are found at once, and motions that take many iterations."""
    rng = np.random.default_rng(0)
    parameters = [rng.uniform(low, high, 12) for low, high in ends]
    omega = rng.uniform(-5, 5, (40, 2))
    omega[:5, 1] = -omega[:5, 0]
    many = kind(*(values[:, None] for values in parameters))
    together = many.twist(omega, GEOMETRY)
    for k, one in enumerate(zip(*parameters, strict=True)):
        alone = [kind(*one).twist(each, GEOMETRY) for each in omega]
        np.testing.assert_allclose(together[k], alone, rtol=1e-11, atol=1e-14)
    if kind is not Exponential:
        back = many.sprocket_speeds(together, GEOMETRY)
        np.testing.assert_allclose(back, np.tile(omega, (12, 1, 1)), rtol=1e-9)


def test_slopes_of_twists_are_those_of_the_closed_form():
    """Of two laws at once: errors of D change the yaw rate alone, those of epsilon both in
    proportion.
    """
    values = np.array([[0.045, 0.01], [-0.02, -0.1]])
    omega = np.random.default_rng(0).uniform(-5, 5, (20, 2))
    slopes = FAMILIES["icr_radius"].twist_slopes(values, omega, GEOMETRY)
    for (offset, radius_error), found in zip(values, slopes, strict=True):
        twist = ConstantIcr(offset, 0.168, radius_error).twist(omega, GEOMETRY)
        by_offset = twist * [0.0, -1 / (0.168 + offset)]
        by_radius_error = twist / (1 + radius_error)
        np.testing.assert_allclose(found[..., 0], by_offset, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(found[..., 1], by_radius_error, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("law", [*LAWS, SPEED, ICR_SIDES, RADII, LOSS_SIDES])
def test_laws_that_turn_on_the_spot_are_continuous_there(law):
    """Turning left, driving slowly ahead and slowly back need almost the same sprocket speeds."""
    ahead, in_place, back = law.sprocket_speeds([[1e-4, 0.3], [0.0, 0.3], [-1e-4, 0.3]], GEOMETRY)
    step = np.abs([ahead - in_place, back - in_place]).max()
    assert law.turns_on_the_spot == (step < 0.01)
    if law.turns_on_the_spot:
        np.testing.assert_allclose(law.twist(in_place, GEOMETRY), [0.0, 0.3], atol=1e-9)


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
def test_families_survive_a_pickle(family):
    """As identifications hold them, which notebooks keep and other processes return."""
    start = dict(zip(family.names, family.starts(GEOMETRY.half_gauge)[0], strict=True))
    held = dict(list(start.items())[1:])
    for each in (family, family.holding(held), family.under(np.full(2, 0.05))):
        again = pickle.loads(pickle.dumps(each))
        values = each.starts(GEOMETRY.half_gauge)[0]
        np.testing.assert_equal(vars(again.law(values, GEOMETRY)), vars(each.law(values, GEOMETRY)))
