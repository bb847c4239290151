"""Drives seen by a stationary laser range finder: results and terminal output."""

from collections.abc import Sequence
from math import degrees
from typing import Any

from experiments.common.formats import number, percent
from experiments.common.table import Table
from trackslip.rangefinder.plate_motion import PlatePlace
from trackslip.ros.scanned import ScannedDrive, Stand

_HEADER = ("run", "scans", "located", "noise [mm]", "on the plate [mm]", "background", "others move")
_SIDES = {"x": ("ahead of", "behind", "the turning centre"), "y": ("to the left of", "to the right of", "the middle")}


def drives_table(title: str, drives: Sequence[ScannedDrive]) -> Table:
    """A row for each drive."""
    rows = [
        (
            drive.log.run,
            str(len(drive.seen.time)),
            percent(float(drive.seen.estimate.valid.mean())),
            number(1e3 * drive.seen.scan.noise, 1),
            number(1e3 * drive.seen.scatter, 1),
            f"{drive.seen.background.beams} of {len(drive.seen.background.level)} beams",
            percent(drive.seen.moving.share),
        )
        for drive in drives
    ]
    return Table(title, _HEADER, rows)


def stand_line(stand: Stand) -> str:
    """A text on the scanner's place."""
    x, y, yaw = stand.mount
    if stand.aligned is None:
        return f"scanner: x = {x:.3f} m, y = {y:.3f} m, yaw = {degrees(yaw):.2f}°, {stand.source}"
    e_x, e_y, e_yaw = stand.aligned.stderr
    place = f"x = {x:.3f} ± {e_x:.2g} m, y = {y:.3f} ± {e_y:.2g} m, yaw = {degrees(yaw):.2f} ± {degrees(e_yaw):.2g}°"
    return f"scanner: {place}, {stand.source}"


def place_lines(place: PlatePlace | None) -> list[str]:
    """A text on the plate's place on the robot."""
    if place is None:
        return ["plate: its place on the robot does not show in this driving"]
    parts = []
    for name, (positive, negative, what) in _SIDES.items():
        if name in place.stderr:
            value = getattr(place, name)
            side = positive if value >= 0 else negative
            parts.append(f"{1e3 * abs(value):.1f} ± {1e3 * place.stderr[name]:.2g} mm {side} {what}")
    if "yaw" in place.stderr:
        side = "left" if place.yaw >= 0 else "right"
        parts.append(f"turned by {degrees(abs(place.yaw)):.2f} ± {degrees(place.stderr['yaw']):.2g}° to the {side}")
    return [f"plate: {', '.join(parts)}, if both tracks slip alike"]


def described(drive: ScannedDrive) -> dict[str, Any]:
    """The summary of a drive, in SI units."""
    seen, stand, place = drive.seen, drive.stand, drive.place
    aligned = stand.aligned
    return {
        "run": drive.log.run,
        "scans": len(seen.time),
        "located": int(seen.estimate.valid.sum()),
        "noise": seen.scan.noise,
        "scatter_on_plate": seen.scatter,
        "dropout": seen.background.dropout,
        "beams_with_background": seen.background.beams,
        "share_others_move": seen.moving.share,
        "front_known": seen.front,
        "mount": stand.mount.tolist(),
        "mount_from": stand.source,
        "mount_stderr": None if aligned is None else aligned.stderr.tolist(),
        "plate_on_robot": None if place is None else {"x": place.x, "y": place.y, "yaw": place.yaw},
        "plate_on_robot_stderr": None if place is None else place.stderr,
    }
