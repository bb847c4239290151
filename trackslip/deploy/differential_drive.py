"""Constant ICRs as parameters of ros2_control's diff_drive_controller, and substitutes for other laws."""

from __future__ import annotations

from trackslip.deploy.facts import comment, fact_lines
from trackslip.deploy.prediction import best_predicting, cost_of
from trackslip.errors import LogError, TrackslipError, require
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import NO_SLIP, StoredLaws

CONTROLLER = "diff_drive_controller"
"""Name of a controller, unless a robot has given it another."""
_NEGLIGIBLE = 1e-6  # distance between two points of the robot [m]


def ros2_control_text(stored: StoredLaws, law: str, controller: str = CONTROLLER) -> str:
    """YAML with the parameters under which diff_drive_controller drives, and computes odometry, by the law.

    Its wheels are at the ICRs: their separation is the distance of the ICRs, their radii are the effective ones. Where
    the D of the tracks differ, its odometry describes the point midway between the ICRs, and a comment says so.

    `controller` is the name of the robot's own. Raises InvalidValueError if it is no name, TrackslipError for a law
    that isn't one of constant ICRs; the message names the nearest one that is.
    """
    is_name = controller.isidentifier() and controller.isascii()
    require(is_name, "controller", controller, "a name of letters, digits and _, as in platform_velocity_controller")
    if not expressible(law):
        raise TrackslipError(f"law = {law!r}: ros2_control can only express constant ICRs; {nearest(stored, law)}")
    b = stored.geometry.half_gauge
    (left, left_error), (right, right_error) = constant_icrs(stored, law)
    parameters = {
        "wheel_separation": 2 * b,
        "wheel_radius": stored.geometry.sprocket_radius,
        "wheel_separation_multiplier": (b + (left + right) / 2) / b,
        "left_wheel_radius_multiplier": 1 + left_error,
        "right_wheel_radius_multiplier": 1 + right_error,
    }
    comments = [*fact_lines(stored, law), *filter(None, [instead_of_best(stored, law)])]
    middle = (left - right) / 2
    if abs(middle) >= _NEGLIGIBLE:
        side = "left" if middle > 0 else "right"
        comments += [
            "The tracks' D differ: wheel_separation_multiplier is that of their mean. Yaw rates are the law's; speeds",
            f"are those of the point midway between the ICRs, {abs(middle):.6f} m to the {side} of the middle of the",
            "tracks: base_frame_id belongs there.",
        ]
    comments += [
        "Put these lines among the parameters of your controller. A wheel_radius_multiplier there overrides those of",
        "left and right: delete it.",
    ]
    lines = [f"    {key}: {yaml_number(value)}\n" for key, value in parameters.items()]
    return comment(comments, "#") + f"{controller}:\n  ros__parameters:\n" + "".join(lines)


def expressible(law: str) -> bool:
    """True if a differential drive can express a law: its sprocket speeds are linear in the twist."""
    return "ros2_control" in FAMILIES[law].targets


def constant_icrs(stored: StoredLaws, law: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """D [m] and epsilon [-] of the left and of the right track under a law of constant ICRs."""
    values = stored.values(law)

    def of(name: str, side: str) -> float:
        return values.get(name, values.get(f"{name}_{side}", 0.0))

    left, right = ((of("offset", side), of("radius_error", side)) for side in ("left", "right"))
    return left, right


def best_expressible(stored: StoredLaws) -> str:
    """The best law if a differential drive can express it, else the best of those that it can, if there are any."""
    best, others = stored.law_named(None), _expressible_laws(stored)
    return best_predicting(stored, others) if others and not expressible(best) else best


def instead_of_best(stored: StoredLaws, law: str) -> str:
    """The accuracy lost by using a law because the best one can't be expressed; empty if the best one can."""
    try:
        best = stored.law_named(None)
    except LogError:
        return ""
    if expressible(best):
        return ""
    return f"The best law is {best}, which ros2_control can't express. Instead, {law}: {cost_of(stored, best, law)}"


def nearest(stored: StoredLaws, law: str) -> str:
    """The best law that a differential drive can express, and the accuracy lost by using it in place of another one."""
    others = _expressible_laws(stored)
    if not others:
        return f"{stored.name} holds none"
    other = best_predicting(stored, others)
    return f"nearest in {stored.name} is {other} (--law {other}): {cost_of(stored, law, other)}"


def _expressible_laws(stored: StoredLaws) -> list[str]:
    return [name for name in stored.laws if name != NO_SLIP and expressible(name)]


def yaml_number(value: float) -> str:
    """A number that YAML 1.1, too, reads exactly and as a float."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return mantissa if not exponent else f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"
