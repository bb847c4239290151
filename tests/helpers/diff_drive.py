"""A model of ros2_control's diff_drive_controller: commands and odometry."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from ruamel.yaml import YAML

from trackslip.kinematics import Array

PARAMETERS = {
    "left_wheel_names",
    "right_wheel_names",
    "wheel_separation",
    "wheel_radius",
    "wheel_separation_multiplier",
    "left_wheel_radius_multiplier",
    "right_wheel_radius_multiplier",
    "odom_frame_id",
    "base_frame_id",
    "open_loop",
    "tf_frame_prefix",
    "tf_frame_prefix_enable",
    "pose_covariance_diagonal",
    "twist_covariance_diagonal",
    "position_feedback",
    "enable_odom_tf",
    "cmd_vel_timeout",
    "publish_limited_velocity",
    "velocity_rolling_window_size",
    "publish_rate",
    "linear",
    "angular",
}
"""Names of its parameters."""


@dataclass(frozen=True)
class DiffDrive:
    separation: float
    left_radius: float
    right_radius: float

    @classmethod
    def of(cls, parameters: Mapping[str, Any]) -> Self:
        separation = parameters["wheel_separation"]
        radius = parameters["wheel_radius"]
        return cls(
            separation * parameters.get("wheel_separation_multiplier", 1.0),
            radius * parameters.get("left_wheel_radius_multiplier", 1.0),
            radius * parameters.get("right_wheel_radius_multiplier", 1.0),
        )

    def wheel_speeds(self, twist: Array) -> Array:
        """Commanded speeds of the (left, right) wheel (..., 2) for twists (..., 2)."""
        v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
        across = w * self.separation / 2
        left = (v - across) / self.left_radius
        right = (v + across) / self.right_radius
        return np.stack([left, right], axis=-1)

    def twist(self, omega: Array) -> Array:
        """Twists (..., 2) by odometry from wheel speeds (..., 2)."""
        left, right = np.moveaxis(np.asarray(omega, float), -1, 0)
        left = left * self.left_radius
        right = right * self.right_radius
        return np.stack([(right + left) / 2, (right - left) / self.separation], axis=-1)


def read_yaml(text: str, version: tuple[int, int] = (1, 2)) -> Any:
    reader = YAML(typ="safe", pure=True)
    reader.version = version  # type: ignore[assignment]
    return reader.load(io.StringIO(text))


def parameters_in(text: str) -> dict[str, Any]:
    content = read_yaml(text)
    assert read_yaml(text, (1, 1)) == content
    assert set(content) == {"diff_drive_controller"}
    assert set(content["diff_drive_controller"]) == {"ros__parameters"}
    return dict(content["diff_drive_controller"]["ros__parameters"])
