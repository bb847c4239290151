"""Laws of constant ICRs as parameters of diff_drive_controller (ROS 1 and 2)."""

from __future__ import annotations

from trackslip.deploy.facts import comment, fact_lines
from trackslip.errors import require
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import NO_SLIP, StoredLaws, number, text

CONTROLLER = "diff_drive_controller"  # default name of a robot's controller
_MEANING = (
    "2 b, distance between the tracks' centre lines [m]",
    "r, radius of the sprockets [m]",
    "(b + D) / b: distance between the ICRs over that between the tracks",
    "1 + epsilon of the left sprocket",
    "1 + epsilon of the right sprocket",
)
_NEGLIGIBLE = 1e-6  # distance below which two points of the robot count as the same [m]
_RATE = 50.0  # default rate at which the controller publishes odometry [Hz]
_UNKNOWN = 1e6  # variance of velocities that the tracks can't measure [m^2/s^2, rad^2/s^2]


def diff_drive_text(
    stored: StoredLaws, law: str, controller: str = CONTROLLER, *, ros: int = 2
) -> str:
    """Write YAML parameters with which diff_drive_controller drives and computes odometry according
    to the law.

    The controller's wheels are at the ICRs: the wheel separation is the distance between the ICRs,
    and the wheels have the effective radii. If D differs between the tracks, odometry describes the
    point midway between the ICRs, as a comment in the file explains. Twist variances are included
    for laws fitted to drives, whose varying slip is known.

    `controller` is the name of the robot's controller, and `ros` the ROS version, 1 or 2. Raises
    InvalidValueError if `controller` isn't a valid name.
    """
    is_name = controller.isidentifier() and controller.isascii()
    require(
        is_name,
        "controller",
        controller,
        "a name of letters, digits and _, as in platform_velocity_controller",
    )
    b = stored.geometry.half_gauge
    (left, left_error), (right, right_error) = constant_icrs(stored, law)
    parameters: dict[str, float | list[float]] = {
        "wheel_separation": 2 * b,
        "wheel_radius": stored.geometry.sprocket_radius,
        "wheel_separation_multiplier": (b + (left + right) / 2) / b,
        "left_wheel_radius_multiplier": 1 + left_error,
        "right_wheel_radius_multiplier": 1 + right_error,
    }
    meaning = dict(zip(parameters, _MEANING, strict=True))
    comments = [*fact_lines(stored, law), *filter(None, [instead_of_best(stored, law)])]
    middle = (left - right) / 2
    if abs(middle) >= _NEGLIGIBLE:
        side = "left" if middle > 0 else "right"
        comments += [
            "The tracks' D differ: wheel_separation_multiplier is that of their mean. Yaw rates "
            "are the law's; speeds",
            f"are those of the point midway between the ICRs, {abs(middle):.6f} m to the {side} "
            "of the middle of the",
            "tracks: base_frame_id belongs there.",
        ]
    variances = _twist_variances(stored, law)
    if variances:
        parameters["twist_covariance_diagonal"] = variances
        comments.append(
            f"twist_covariance_diagonal is for 1 m/s and {_RATE:g} messages a second; it is "
            "proportional to both."
        )
    comments += [
        "Put these lines among the parameters of your controller. A wheel_radius_multiplier "
        "there overrides those of",
        "left and right: delete it.",
    ]
    head, indent = ("  ros__parameters:\n", "    ") if ros == 2 else ("", "  ")
    lines = []
    for key, value in parameters.items():
        about = f"  # {meaning[key]}" if key in meaning else ""
        text = (
            f"[{', '.join(map(yaml_number, value))}]"
            if isinstance(value, list)
            else yaml_number(value)
        )
        lines.append(f"{indent}{key}: {text}{about}\n")
    return comment(comments, "#") + f"{controller}:\n{head}" + "".join(lines)


def _twist_variances(stored: StoredLaws, law: str) -> list[float]:
    """Variances of the x, y, z, roll, pitch and yaw rates that match the varying slip; empty if
    unknown.
    """
    deviations = [
        number(stored.content, "drive", "laws", law, "noise", f"slip_{what}")
        for what in ("forward", "sideways", "turn")
    ]
    if stored.content.get("method") != "drive" or None in deviations:
        return []
    forward, sideways, turn = (
        float(f"{_RATE * size**2:.3g}") for size in deviations if size is not None
    )
    return [forward, sideways, _UNKNOWN, _UNKNOWN, _UNKNOWN, turn]


def expressible(law: str) -> bool:
    """Whether a differential drive can express a law, which requires sprocket speeds that are
    linear in the twist.
    """
    return "ros2_control" in FAMILIES[law].targets


def constant_icrs(stored: StoredLaws, law: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """D [m] and epsilon [-] of the left track and of the right track, for a law of constant
    ICRs.
    """
    values = stored.values(law)

    def of(name: str, side: str) -> float:
        return values.get(name, values.get(f"{name}_{side}", 0.0))

    left, right = ((of("offset", side), of("radius_error", side)) for side in ("left", "right"))
    return left, right


def law_for(stored: StoredLaws, target: str) -> str:
    """Name of the law for a target: for diff_drive_controller, the law that gives the answer of the
    identification; for others, the best law if the target can express it.
    """
    best, answer = stored.law_named(None), text(stored.content, "expressible")
    is_controller = target in ("ros2_control", "ros_control")
    if answer in stored.laws and (is_controller or target not in FAMILIES[best].targets):
        return answer
    return best


def instead_of_best(stored: StoredLaws, law: str) -> str:
    """A sentence if `law` isn't the best law; empty if `law` is the best law or the best law is
    unknown.
    """
    best = text(stored.content, "best")
    return f"The best law is {best}: this is {law}" if best not in ("", law) else ""


def nearest(stored: StoredLaws, target: str) -> str:
    """A phrase that lists the stored laws that a target can express."""
    known = [name for name in stored.laws if name != NO_SLIP and target in FAMILIES[name].targets]
    return f"those in {stored.name}: {', '.join(known) or 'none'}"


def yaml_number(value: float) -> str:
    """Format a number so that even YAML 1.1 reads it exactly, as a float."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (
        mantissa
        if not exponent
        else f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"
    )
