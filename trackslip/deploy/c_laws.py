"""C of the laws, for headers: the same equations, in the same order, as in trackslip.slip."""

from __future__ import annotations

TYPES = """\
struct trackslip_omega {
    double left;  /* sprocket speeds [rad/s], positive forwards */
    double right;
};

struct trackslip_twist {
    double v; /* speed forwards [m/s] */
    double w; /* yaw rate, counter-clockwise [rad/s] */
};
"""

ICR = """\
/* Sprocket speeds that produce the twist (v, w). */
static inline struct trackslip_omega trackslip_sprocket_speeds(double v, double w)
{
    struct trackslip_omega omega;
    omega.left = (v - trackslip_reach_left * w) / (trackslip_sprocket_radius * trackslip_scale_left);
    omega.right = (v + trackslip_reach_right * w) / (trackslip_sprocket_radius * trackslip_scale_right);
    return omega;
}

/* The twist that sprocket speeds produce. */
static inline struct trackslip_twist trackslip_body_twist(double omega_left, double omega_right)
{
    const double left = trackslip_sprocket_radius * trackslip_scale_left * omega_left;
    const double right = trackslip_sprocket_radius * trackslip_scale_right * omega_right;
    struct trackslip_twist twist;
    twist.w = (right - left) / (trackslip_reach_left + trackslip_reach_right);
    twist.v = right - trackslip_reach_right * twist.w;
    return twist;
}
"""

TURN_LOSS = """\
/* sin theta, with tan theta = difference / mean of the belts' speeds. */
static inline double trackslip_sine(double difference, double mean)
{
    const double size = hypot(difference, mean);
    return size == 0.0 ? difference : difference / size;
}

/* Sprocket speeds that produce the twist (v, w): Newton's method on the belts' mean speed, guarded by bisection. */
static inline struct trackslip_omega trackslip_sprocket_speeds(double v, double w)
{
    const double loss = trackslip_turn_loss;
    const double radius = trackslip_sprocket_radius * (1.0 + trackslip_radius_error);
    const double difference = (trackslip_half_gauge + trackslip_offset) * w;
    const double largest = fabs(v) > fabs(difference) ? fabs(v) : fabs(difference);
    const double size = largest == 0.0 ? 1.0 : largest;
    const double goal = fabs(v) / size;
    const double d = fabs(difference) / size;
    double low = loss < 0.0 ? goal / (1.0 - loss) : goal;
    double high = loss < 0.0 ? goal : goal / (1.0 - loss);
    double mean = goal;
    struct trackslip_omega omega;
    int k;
    for (k = 0; k < 60; ++k) {
        const double sine = trackslip_sine(d, mean);
        const double missed = mean * (1.0 - loss * (sine * sine)) - goal;
        const double slope = 1.0 - loss * (sine * sine) * (2.0 * (sine * sine) - 1.0);
        const double newton = mean - missed / slope;
        double step;
        low = missed < 0.0 ? mean : low;
        high = missed > 0.0 ? mean : high;
        step = mean;
        mean = newton >= low && newton <= high ? newton : (low + high) / 2.0;
        step = fabs(mean - step);
        if (step < 1e-15) {
            break;
        }
    }
    mean = copysign(mean, v) * size;
    omega.left = (mean - difference) / radius;
    omega.right = (mean + difference) / radius;
    return omega;
}

/* The twist that sprocket speeds produce. */
static inline struct trackslip_twist trackslip_body_twist(double omega_left, double omega_right)
{
    const double radius = trackslip_sprocket_radius * (1.0 + trackslip_radius_error);
    const double mean = (radius * omega_right + radius * omega_left) / 2.0;
    const double difference = (radius * omega_right - radius * omega_left) / 2.0;
    const double sine = trackslip_sine(difference, mean);
    struct trackslip_twist twist;
    twist.v = mean * (1.0 - trackslip_turn_loss * (sine * sine));
    twist.w = difference / (trackslip_half_gauge + trackslip_offset);
    return twist;
}
"""

EXPONENTIAL = """\
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

/* Slips of the tracks at the twist (v, w). */
static inline struct trackslip_slip trackslip_slip_at(double v, double w)
{
    const double kappa = trackslip_curvature(v, w);
    const double radius = 1.0 / fabs(kappa);
    return trackslip_by_side(kappa, trackslip_alpha_inner * exp(trackslip_beta_inner * radius),
                             trackslip_alpha_outer * exp(trackslip_beta_outer * radius));
}

/* Sprocket speeds that produce the twist (v, w). */
static inline struct trackslip_omega trackslip_sprocket_speeds(double v, double w)
{
    const struct trackslip_slip slip = trackslip_slip_at(v, w);
    struct trackslip_omega omega;
    omega.left = (v - trackslip_half_gauge * w) / (trackslip_sprocket_radius * (1.0 - slip.left));
    omega.right = (v + trackslip_half_gauge * w) / (trackslip_sprocket_radius * (1.0 - slip.right));
    return omega;
}

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
