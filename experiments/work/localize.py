"""`trackslip localize`: poses of a robot's plate from the scans of a laser range finder beside the field."""

import shlex
import time
from collections.abc import Sequence
from math import degrees
from typing import Any

import matplotlib

from experiments.options.localize import LocalizeConfig
from experiments.report.figures.field import field
from experiments.report.formats import for_terminal, number, percent
from experiments.report.page import Drawing
from experiments.report.terminal import busy, print_table
from experiments.storage.manifest import make_manifest
from experiments.storage.results import FIGURES_FOLDER, RUNS_FILE, results_folder, write_results
from trackslip.rangefinder.place import PlatePlace
from trackslip.ros.scanned import ScannedDrive, Stand, read_scanned

_HEADER = ("run", "scans", "located", "noise [mm]", "on the plate [mm]", "background", "others move")
_MOST_ROWS = 30  # of the table
_SIDES = {"x": ("ahead of", "behind", "the turning centre"), "y": ("to the left of", "to the right of", "the middle")}


def run(config: LocalizeConfig) -> None:
    """Locate, store and print."""
    began = time.perf_counter()
    with results_folder(config.out) as folder:
        with busy("localization"):
            found = read_scanned(config.path, config.choice())
        drives = found.drives
        wall = time.perf_counter() - began
        warnings = (*found.notes, *map(str, found.refused))
        summary = {"drives": [_described(drive) for drive in drives], "warnings": warnings, "timing": {"wall_s": wall}}
        write_results(folder, summary, make_manifest("localize", config, wall), [drive.log for drive in drives])
        (folder / FIGURES_FOLDER).mkdir()
        drawing = Drawing("field", field(drives))
        file = folder / FIGURES_FOLDER / drawing.name
        file.with_suffix(".svg").write_text(drawing.svg, encoding="utf-8")
        if config.pdf:
            with matplotlib.rc_context({"pdf.fonttype": 42}):
                drawing.figure.savefig(file.with_suffix(".pdf"), metadata={"CreationDate": None})
    print(drives[0].taken)
    print_table(f"The plate of {config.plate} m in scans", _HEADER, for_terminal(_rows(drives[:_MOST_ROWS])))
    if len(drives) > _MOST_ROWS:
        print(f"and {len(drives) - _MOST_ROWS} more")
    for line in dict.fromkeys(_stand_line(drive.stand) for drive in drives):
        print(line)
    if len(drives) == 1:
        for line in _place_lines(drives[0].place):
            print(line)
    for line in warnings:
        print(f"warning: {line}")
    print(f"{config.out / RUNS_FILE}: {wall:.1f} s; next: trackslip identify {shlex.quote(str(config.out))}")


def _rows(drives: Sequence[ScannedDrive]) -> list[tuple[str, ...]]:
    """A row per drive."""
    return [
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


def _stand_line(stand: Stand) -> str:
    """Where the scanner stands."""
    x, y, yaw = stand.mount
    if stand.aligned is None:
        return f"scanner: x = {x:.3f} m, y = {y:.3f} m, yaw = {degrees(yaw):.2f}°, {stand.source}"
    e_x, e_y, e_yaw = stand.aligned.stderr
    place = f"x = {x:.3f} ± {e_x:.2g} m, y = {y:.3f} ± {e_y:.2g} m, yaw = {degrees(yaw):.2f} ± {degrees(e_yaw):.2g}°"
    return f"scanner: {place}, {stand.source}"


def _place_lines(place: PlatePlace | None) -> list[str]:
    """Where the plate sits on the robot."""
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


def _described(drive: ScannedDrive) -> dict[str, Any]:
    """What the summary says of a drive, in SI units."""
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
