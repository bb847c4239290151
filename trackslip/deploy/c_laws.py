"""C of the laws with constant ICRs, for headers: the same equations, in the same order, as in trackslip.slip."""

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
