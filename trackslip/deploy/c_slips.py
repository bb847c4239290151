"""C of the laws of slip ratios, for headers: the same equations, in the same order, as in trackslip.slip."""

from __future__ import annotations

SLIP = """\
struct trackslip_slip {
    double left;
    double right;
};

/* Curvature of the path; signed infinity when turning in place, 0 at rest. */
static inline double trackslip_curvature(double v, double w)
{
    if (v == 0.0) {
        return w == 0.0 ? 0.0 : copysign(INFINITY, w);
    }
    return w / v;
}

"""

BY_SIDE = """\
/* Slips of (left, right) from those of the inner and outer track; their mean on a straight path. */
static inline struct trackslip_slip trackslip_by_side(double kappa, double inner, double outer)
{
    const double side = kappa > 0.0 ? 1.0 : (kappa < 0.0 ? -1.0 : 0.0);
    const double mean = (inner + outer) / 2.0;
    const double half = (inner - outer) / 2.0;
    struct trackslip_slip slip;
    slip.left = mean + side * half;
    slip.right = mean - side * half;
    return slip;
}

"""

_SLIP_AT = """\
/* Slips of the tracks at the twist (v, w). */
static inline struct trackslip_slip trackslip_slip_at(double v, double w)
{
    const double kappa = trackslip_curvature(v, w);
"""

SLIPS = {
    "constant": BY_SIDE
    + _SLIP_AT
    + """\
    return trackslip_by_side(kappa, trackslip_slip_inner, trackslip_slip_outer);
}

""",
    "exponential": BY_SIDE
    + _SLIP_AT
    + """\
    const double radius = 1.0 / fabs(kappa);
    return trackslip_by_side(kappa, trackslip_alpha_inner * exp(trackslip_beta_inner * radius),
                             trackslip_alpha_outer * exp(trackslip_beta_outer * radius));
}

""",
    "exponential_speed": BY_SIDE
    + _SLIP_AT
    + """\
    const double radius = 1.0 / fabs(kappa);
    const double inner = trackslip_alpha_inner + trackslip_gamma_inner * fabs(v);
    const double outer = trackslip_alpha_outer + trackslip_gamma_outer * fabs(v);
    return trackslip_by_side(kappa, inner * exp(trackslip_beta_inner * radius),
                             outer * exp(trackslip_beta_outer * radius));
}

""",
    "power": BY_SIDE
    + _SLIP_AT
    + """\
    const double base = 1.0 + 1.0 / fabs(kappa) / trackslip_half_gauge;
    return trackslip_by_side(kappa, trackslip_alpha_inner * pow(base, trackslip_beta_inner),
                             trackslip_alpha_outer * pow(base, trackslip_beta_outer));
}

""",
    "hyperbola": _SLIP_AT
    + """\
    const double along = cos(atan(kappa));
    const double turning = sin(atan(kappa));
    struct trackslip_slip slip;
    slip.left = -trackslip_size * turning / (along - trackslip_pole * turning);
    slip.right = trackslip_size * turning / (along + trackslip_pole * turning);
    return slip;
}

""",
}
"""C of the function from twist to slip, by law."""

SPROCKET_SPEEDS = """\
/* Sprocket speeds that produce the twist (v, w). */
static inline struct trackslip_omega trackslip_sprocket_speeds(double v, double w)
{
    const struct trackslip_slip slip = trackslip_slip_at(v, w);
    struct trackslip_omega omega;
    omega.left = (v - trackslip_half_gauge * w) / (trackslip_sprocket_radius * (1.0 - slip.left));
    omega.right = (v + trackslip_half_gauge * w) / (trackslip_sprocket_radius * (1.0 - slip.right));
    return omega;
}

"""

CONSTANT_TWIST = """\
/* Positive for track speeds of a left turn, negative for those of a right one. */
static inline double trackslip_outwards(double left, double right)
{
    return left + right == 0.0 ? right : fabs(right) - fabs(left);
}

/* The twist that sprocket speeds produce; where neither a left nor a right turn has them, the robot goes straight or
   turns in place, with slips in between. */
static inline struct trackslip_twist trackslip_body_twist(double omega_left, double omega_right)
{
    const double belt_left = trackslip_sprocket_radius * omega_left;
    const double belt_right = trackslip_sprocket_radius * omega_right;
    const double inner = 1.0 - trackslip_slip_inner;
    const double outer = 1.0 - trackslip_slip_outer;
    const double if_left = trackslip_outwards(belt_left * inner, belt_right * outer);
    const double if_right = trackslip_outwards(belt_left * outer, belt_right * inner);
    double left;
    double right;
    struct trackslip_twist twist;
    if (if_left > 0.0 && (!(if_right < 0.0) || trackslip_outwards(belt_left, belt_right) > 0.0)) {
        left = belt_left * inner;
        right = belt_right * outer;
    } else if (if_right < 0.0) {
        left = belt_left * outer;
        right = belt_right * inner;
    } else {
        const double product = belt_left * belt_right;
        const double side = product < 0.0 ? -1.0 : 1.0;
        const double both = belt_left + side * belt_right;
        const double between = (inner + outer) * product / (both == 0.0 ? INFINITY : both);
        left = between * side;
        right = between * (side * side);
    }
    twist.v = (right + left) / 2.0;
    twist.w = (right - left) / (2.0 * trackslip_half_gauge);
    return twist;
}
"""

TWIST = """\
/* v and b w of sprocket speeds without slip. */
static inline struct trackslip_twist trackslip_commanded(double omega_left, double omega_right)
{
    const double left = trackslip_sprocket_radius * omega_left;
    const double right = trackslip_sprocket_radius * omega_right;
    struct trackslip_twist plane;
    plane.v = (right + left) / 2.0;
    plane.w = trackslip_half_gauge * ((right - left) / (2.0 * trackslip_half_gauge));
    return plane;
}

/* Quotient of two complex numbers (v + i w), scaled so that nothing overflows; 1 where there is none. */
static inline struct trackslip_twist trackslip_quotient(struct trackslip_twist a, struct trackslip_twist b)
{
    const int flat = fabs(b.v) >= fabs(b.w);
    const double share = flat ? b.w / b.v : b.v / b.w;
    const double size = flat ? b.v + b.w * share : b.v * share + b.w;
    struct trackslip_twist ratio;
    ratio.v = (flat ? a.v + a.w * share : a.v * share + a.w) / size;
    ratio.w = (flat ? a.w - a.v * share : a.w * share - a.v) / size;
    if (!isfinite(ratio.v) || !isfinite(ratio.w) || (ratio.v == 0.0 && ratio.w == 0.0)) {
        ratio.v = 1.0;
        ratio.w = 0.0;
    }
    return ratio;
}

/* b w of the turn in place, with slips between those of left and right turns, with these speeds; 0 for none. */
static inline double trackslip_in_place(double omega_left, double omega_right)
{
    const struct trackslip_slip slip = trackslip_slip_at(0.0, 1.0);
    const double inner = slip.left;
    const double outer = slip.right;
    const double left = trackslip_sprocket_radius * omega_left;
    const double right = trackslip_sprocket_radius * omega_right;
    double turning;
    double beyond;
    if (!(left * right < 0.0) || !(outer > inner)) {
        return 0.0;
    }
    turning = (2.0 - inner - outer) / (1.0 / right - 1.0 / left);
    beyond = (1.0 - turning / right - (inner + outer) / 2.0) / ((outer - inner) / 2.0);
    return fabs(beyond) <= 1.0 + 1e-9 ? turning : 0.0;
}

/* The twist that sprocket speeds produce: the secant method rotates and scales it until trackslip_sprocket_speeds
   gives these speeds. Where there is no such twist, or more than one, it is close to one. */
static inline struct trackslip_twist trackslip_body_twist(double omega_left, double omega_right)
{
    const double turning = trackslip_in_place(omega_left, omega_right);
    const struct trackslip_twist commanded = trackslip_commanded(omega_left, omega_right);
    struct trackslip_twist real = commanded;
    double wrong = 0.0;
    double turned = 0.0;
    int k;
    if (turning != 0.0) {
        real.v = 0.0;
        real.w = turning / trackslip_half_gauge;
        return real;
    }
    for (k = 0; k < trackslip_iterations; ++k) {
        const struct trackslip_omega omega = trackslip_sprocket_speeds(real.v, real.w / trackslip_half_gauge);
        const struct trackslip_twist ratio =
            trackslip_quotient(commanded, trackslip_commanded(omega.left, omega.right));
        const double size = hypot(ratio.v, ratio.w);
        const double missed = atan2(ratio.w, ratio.v);
        const struct trackslip_twist before = real;
        double slope = k > 0 ? (wrong - missed) / turned : 1.0;
        slope = isnan(slope) ? 1.0 : (slope < 0.2 ? 0.2 : (slope > 5.0 ? 5.0 : slope));
        turned = missed / slope;
        wrong = missed;
        real.v = size * (before.v * cos(turned) - before.w * sin(turned));
        real.w = size * (before.v * sin(turned) + before.w * cos(turned));
        if (hypot(ratio.v - 1.0, ratio.w) < 1e-12) {
            break;
        }
    }
    real.w = real.w / trackslip_half_gauge;
    return real;
}
"""
