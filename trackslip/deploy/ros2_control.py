"""Parameters of ros2_control's diff_drive_controller."""

from __future__ import annotations

from trackslip.deploy.expressible import instead_of, require_expressible
from trackslip.deploy.facts import commented, fact_lines
from trackslip.slip.stored_laws import StoredLaws

_NEGLIGIBLE = 1e-6  # distance between two points of the robot [m]


def ros2_control_text(stored: StoredLaws, law: str) -> str:
    """YAML with the parameters by which diff_drive_controller moves, and reckons, as the law says.

    Raises TrackslipError for a law that they can't express.
    """
    drive = require_expressible(stored, law)
    parameters = {
        "wheel_separation": 2 * stored.geometry.half_gauge,
        "wheel_radius": stored.geometry.sprocket_radius,
        "wheel_separation_multiplier": drive.separation_multiplier,
        "left_wheel_radius_multiplier": drive.left_radius_multiplier,
        "right_wheel_radius_multiplier": drive.right_radius_multiplier,
    }
    instead = instead_of(stored, law)
    comments = [*fact_lines(stored, law), *([instead] if instead else []), *_shift_lines(drive.middle)]
    comments += ["Put these lines among the parameters of your controller, under its own name."]
    lines = [f"    {key}: {yaml_number(value)}\n" for key, value in parameters.items()]
    return commented(comments, "#") + "diff_drive_controller:\n  ros__parameters:\n" + "".join(lines)


def _shift_lines(middle: float) -> list[str]:
    """What to know of ICRs that do not lie symmetrically."""
    if abs(middle) < _NEGLIGIBLE:
        return []
    side = "left" if middle > 0 else "right"
    return [
        "The tracks' D differ: wheel_separation_multiplier is that of their mean. Yaw rates are the law's; speeds are",
        f"those of the point midway between the ICRs, {abs(middle):.6f} m to the {side} of the middle of the tracks:",
        "base_frame_id belongs there.",
    ]


def yaml_number(value: float) -> str:
    """A number that YAML 1.1, too, reads as one with a fraction, exactly."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return mantissa if not exponent else f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"
