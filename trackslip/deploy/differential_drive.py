"""Laws of constant ICRs as parameters of diff_drive_controller (ROS 1 and 2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from trackslip.deploy.facts import comment, fact_lines
from trackslip.errors import require
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import NO_SLIP, StoredLaws, number, text

CONTROLLER: Final = "diff_drive_controller"
"""Default name of a robot's controller."""
_MEANINGS: Final = {
    "wheel_separation": "2 b, distance between the tracks' centre lines [m]",
    "wheel_radius": "r, radius of the sprockets [m]",
    "wheel_separation_multiplier": (
        "(b + D) / b: distance between the ICRs over that between the tracks"
    ),
    "left_wheel_radius_multiplier": "1 + epsilon of the left sprocket",
    "right_wheel_radius_multiplier": "1 + epsilon of the right sprocket",
}
_SAME_PLACE: Final = 1e-6  # distance below which two points of the robot count as the same [m]
_ODOMETRY_RATE: Final = 50.0  # default rate at which the controller publishes odometry [Hz]
# variance of velocities that the tracks can't measure [m^2/s^2, rad^2/s^2]
_UNKNOWN_VARIANCE: Final = 1e6


@dataclass(frozen=True)
class ConstantIcrs:
    """D [m] and epsilon [-] of the left and of the right track."""

    left_offset: float
    left_error: float
    right_offset: float
    right_error: float


def diff_drive_text(
    stored: StoredLaws, law: str, controller: str = CONTROLLER, *, ros: int = 2
) -> str:
    """Write YAML parameters with which diff_drive_controller drives and computes odometry.

    Both follow the law. The controller's wheels are at the ICRs: the wheel separation is the
    distance between the ICRs, and the wheels have the effective radii. If D differs between the
    tracks, odometry describes the point midway between the ICRs, as a comment in the file explains.
    Twist variances are included for laws fitted to drives, whose varying slip is known.

    `controller` is the name of the robot's controller, and `ros` the ROS version, 1 or 2. Raises
    InvalidValueError if `controller` isn't a valid name.
    """
    is_name = controller.isidentifier() and controller.isascii()
    allowed = "a name of letters, digits and _, as in platform_velocity_controller"
    require(is_name, "controller", controller, allowed)

    b = stored.geometry.half_gauge
    icrs = constant_icrs(stored, law)
    offset = (icrs.left_offset + icrs.right_offset) / 2
    parameters: dict[str, float] = {
        "wheel_separation": 2 * b,
        "wheel_radius": stored.geometry.sprocket_radius,
        "wheel_separation_multiplier": (b + offset) / b,
        "left_wheel_radius_multiplier": 1 + icrs.left_error,
        "right_wheel_radius_multiplier": 1 + icrs.right_error,
    }
    lines = [
        f"{name}: {yaml_number(value)}  # {_MEANINGS[name]}" for name, value in parameters.items()
    ]
    variances = _slip_variances(stored, law)
    if all(variances.values()):
        unknown = [_UNKNOWN_VARIANCE] * 3
        diagonal = [variances["forward"], variances["sideways"], *unknown, variances["turn"]]
        lines.append(f"twist_covariance_diagonal: [{', '.join(map(yaml_number, diagonal))}]")

    head = f"{controller}:\n"
    indent = "  "
    if ros == 2:
        head += "  ros__parameters:\n"
        indent = "    "
    body = "".join(f"{indent}{line}\n" for line in lines)
    comments = _comments(stored, law, icrs, variances)
    return comment(comments, "#") + head + body


def _comments(
    stored: StoredLaws, law: str, icrs: ConstantIcrs, variances: Mapping[str, float]
) -> list[str]:
    """Lines of comments that stand before the parameters, with the `variances` of the slip."""
    comments = fact_lines(stored, law)
    other_law = instead_of_best(stored, law)
    if other_law:
        comments.append(f"Warning: {other_law}")
    middle = (icrs.left_offset - icrs.right_offset) / 2
    if abs(middle) >= _SAME_PLACE:
        side = "left" if middle > 0 else "right"
        comments += [
            "The tracks' D differ: wheel_separation_multiplier is that of their mean. Yaw rates "
            "are the law's; speeds",
            f"are those of the point midway between the ICRs, {abs(middle):.6f} m to the {side} "
            "of the middle of the",
            "tracks: base_frame_id belongs there.",
        ]
    missing = [name for name, variance in variances.items() if variance == 0]
    if missing and len(missing) < len(variances):
        comments.append(
            f"twist_covariance_diagonal is left out: the drives don't tell how much slip varies "
            f"({', '.join(missing)})."
        )
    if not missing:
        comments.append(
            f"twist_covariance_diagonal is for 1 m/s and {_ODOMETRY_RATE:g} messages a second; it "
            "is proportional to both."
        )
    comments += [
        "Put these lines among the parameters of your controller. A wheel_radius_multiplier "
        "there overrides those of",
        "left and right: delete it.",
    ]
    return comments


def _slip_variances(stored: StoredLaws, law: str) -> dict[str, float]:
    """Variances of the mean velocities forwards, sideways and in turn between two messages at
    1 m/s, by the varying slip, to three digits; 0 where unknown, as without measured headings.
    """
    of_drives = stored.content.get("method") == "drive"
    variances = {}
    for name in ("forward", "sideways", "turn"):
        keys = ("drive", "laws", law, "noise", f"slip_{name}")
        deviation = number(stored.content, *keys) if of_drives else None
        variances[name] = float(f"{_ODOMETRY_RATE * (deviation or 0.0) ** 2:.3g}")
    return variances


def has_constant_icrs(law: str) -> bool:
    """Whether a differential drive can express a law: sprocket speeds are linear in the twist."""
    return "ros2_control" in FAMILIES[law].targets


def constant_icrs(stored: StoredLaws, law: str) -> ConstantIcrs:
    """The constants of a law; those it has not are 0, and those without a side hold for both."""
    values = stored.values(law)

    def constant(name: str, side: str) -> float:
        return values.get(name, values.get(f"{name}_{side}", 0.0))

    return ConstantIcrs(
        left_offset=constant("offset", "left"),
        left_error=constant("radius_error", "left"),
        right_offset=constant("offset", "right"),
        right_error=constant("radius_error", "right"),
    )


def law_for(stored: StoredLaws, target: str) -> str:
    """Name of the law for a target: for diff_drive_controller, the law that gives the answer of the
    identification; for others, the best law if the target can express it.
    """
    best = stored.law_named(None)
    answer = text(stored.content, "expressible")
    is_controller = target in ("ros2_control", "ros_control")
    if answer in stored.laws and (is_controller or target not in FAMILIES[best].targets):
        return answer
    return best


def instead_of_best(stored: StoredLaws, law: str) -> str:
    """A sentence if `law` isn't the best law; empty if it is, or if the best law is unknown."""
    best = text(stored.content, "best")
    if best in ("", law):
        return ""
    return f"exported {law}, not the best law ({best})"


def nearest(stored: StoredLaws, target: str) -> str:
    """A phrase that lists the stored laws that a target can express."""
    known = [name for name in stored.laws if name != NO_SLIP and target in FAMILIES[name].targets]
    return f"those in {stored.name}: {', '.join(known) or 'none'}"


def yaml_number(value: float) -> str:
    """Format a number so that even YAML 1.1 reads it exactly, as a float."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    if not exponent:
        return mantissa
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}e{exponent}"
