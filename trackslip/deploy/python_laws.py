"""Python of the slip laws, for files that need nothing but `math`: the same equations as in trackslip.slip."""

from __future__ import annotations

ICR = '''\
def sprocket_speeds(v, w):
    """Sprocket speeds (left, right) [rad/s] that produce the twist v [m/s], w [rad/s]."""
    left = (v - REACH_LEFT * w) / (SPROCKET_RADIUS * SCALE_LEFT)
    right = (v + REACH_RIGHT * w) / (SPROCKET_RADIUS * SCALE_RIGHT)
    return left, right


def body_twist(omega_left, omega_right):
    """The twist (v, w) [m/s, rad/s] that sprocket speeds [rad/s] produce."""
    left = SPROCKET_RADIUS * SCALE_LEFT * omega_left
    right = SPROCKET_RADIUS * SCALE_RIGHT * omega_right
    w = (right - left) / (REACH_LEFT + REACH_RIGHT)
    return right - REACH_RIGHT * w, w
'''

TURN_LOSS = '''\
def sprocket_speeds(v, w):
    """Sprocket speeds (left, right) [rad/s] that produce the twist v [m/s], w [rad/s].

    Newton's method on the belts' mean speed, guarded by bisection.
    """
    difference = (HALF_GAUGE + OFFSET) * w
    size = max(abs(v), abs(difference)) or 1.0
    goal, d = abs(v) / size, abs(difference) / size
    low, high = sorted((goal, goal / (1.0 - TURN_LOSS)))
    mean = goal
    for _ in range(60):
        square = _sine(d, mean) ** 2
        missed = mean * (1.0 - TURN_LOSS * square) - goal
        newton = mean - missed / (1.0 - TURN_LOSS * square * (2.0 * square - 1.0))
        low, high = (mean if missed < 0.0 else low), (mean if missed > 0.0 else high)
        before, mean = mean, newton if low <= newton <= high else (low + high) / 2.0
        if abs(mean - before) < 1e-15:
            break
    mean = math.copysign(mean, v) * size
    radius = SPROCKET_RADIUS * (1.0 + RADIUS_ERROR)
    return (mean - difference) / radius, (mean + difference) / radius


def body_twist(omega_left, omega_right):
    """The twist (v, w) [m/s, rad/s] that sprocket speeds [rad/s] produce."""
    radius = SPROCKET_RADIUS * (1.0 + RADIUS_ERROR)
    mean = (radius * omega_right + radius * omega_left) / 2.0
    difference = (radius * omega_right - radius * omega_left) / 2.0
    return mean * (1.0 - TURN_LOSS * _sine(difference, mean) ** 2), difference / (HALF_GAUGE + OFFSET)


def _sine(difference, mean):
    """sin theta, with tan theta = difference / mean."""
    return difference / (math.hypot(difference, mean) or 1.0)
'''

EXPONENTIAL = '''\
def sprocket_speeds(v, w):
    """Sprocket speeds (left, right) [rad/s] that produce the twist v [m/s], w [rad/s]."""
    left, right = _slips(v, w)
    return (
        _divided(v - HALF_GAUGE * w, SPROCKET_RADIUS * (1.0 - left)),
        _divided(v + HALF_GAUGE * w, SPROCKET_RADIUS * (1.0 - right)),
    )


def body_twist(omega_left, omega_right):
    """The twist (v, w) [m/s, rad/s] that sprocket speeds [rad/s] produce.

    The secant method rotates and scales the twist, a point v + i b w, until `sprocket_speeds` gives these speeds. Where
    there is no such twist, or more than one, the result is close to one.
    """
    turning = _in_place(omega_left, omega_right)
    if turning != 0.0:
        return 0.0, turning / HALF_GAUGE
    commanded = real = _commanded(omega_left, omega_right)
    wrong = turned = 0.0
    for k in range(ITERATIONS):
        ratio = _quotient(commanded, _commanded(*sprocket_speeds(real.real, real.imag / HALF_GAUGE)))
        size, missed = math.hypot(ratio.real, ratio.imag), math.atan2(ratio.imag, ratio.real)
        slope = _divided(wrong - missed, turned) if k > 0 else 1.0
        turned = missed / (1.0 if math.isnan(slope) else min(max(slope, 0.2), 5.0))
        wrong = missed
        real *= size * complex(math.cos(turned), math.sin(turned))
        if abs(ratio - 1.0) < 1e-12:
            break
    return real.real, real.imag / HALF_GAUGE


def _in_place(omega_left, omega_right):
    """b w of the turn in place, with slips between those of left and right turns, with these speeds; 0 for none."""
    inner, outer = _slips(0.0, 1.0)
    left, right = SPROCKET_RADIUS * omega_left, SPROCKET_RADIUS * omega_right
    if not (left * right < 0.0 and outer > inner):
        return 0.0
    turning = (2.0 - inner - outer) / (1.0 / right - 1.0 / left)
    beyond = (1.0 - turning / right - (inner + outer) / 2.0) / ((outer - inner) / 2.0)
    return turning if abs(beyond) <= 1.0 + 1e-9 else 0.0


def _commanded(omega_left, omega_right):
    """v + i b w of sprocket speeds without slip."""
    left, right = SPROCKET_RADIUS * omega_left, SPROCKET_RADIUS * omega_right
    return complex((right + left) / 2.0, HALF_GAUGE * ((right - left) / (2.0 * HALF_GAUGE)))


def _quotient(some, other):
    """some / other; 1 where that is nothing to turn by."""
    ratio = some / other if other != 0.0 else 1.0 + 0.0j
    return ratio if ratio != 0.0 and math.isfinite(ratio.real) and math.isfinite(ratio.imag) else 1.0 + 0.0j


def _slips(v, w):
    """Slips of the tracks (left, right) at the twist (v, w)."""
    kappa = _curvature(v, w)
    radius = _divided(1.0, abs(kappa))
    inner, outer = ALPHA_INNER * math.exp(BETA_INNER * radius), ALPHA_OUTER * math.exp(BETA_OUTER * radius)
    return _by_side(kappa, inner, outer)


def _by_side(kappa, inner, outer):
    """Slips of (left, right) from those of the inner and outer track; their mean on a straight path."""
    side = (kappa > 0.0) - (kappa < 0.0)
    mean, half = (inner + outer) / 2.0, (inner - outer) / 2.0
    return mean + side * half, mean - side * half


def _curvature(v, w):
    """Curvature of the path; signed infinity when turning in place, 0 at rest."""
    if v == 0.0:
        return 0.0 if w == 0.0 else math.copysign(math.inf, w)
    return w / v


def _divided(some, other):
    """some / other, infinite or NaN where other is 0."""
    if other != 0.0:
        return some / other
    return math.nan if some == 0.0 or math.isnan(some) else math.copysign(math.inf, some) * math.copysign(1.0, other)
'''
