"""Courses by name, or from a TOML file."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import models
from sim.terrain.course import Course
from sim.terrain.field_files import Mesh, Picture
from sim.terrain.fields import Rough
from sim.terrain.loose import Beams, Pallets
from sim.terrain.pieces import Flat, Gap, Piece, Ramp, SideSlope, Stairs, Step
from sim.toml_file import build, read_named, read_toml
from trackslip.errors import InvalidValueError, SettingsFileError

_COURSES = Path(models.__file__).parent / "courses"
_KINDS: dict[str, type[Any]] = {
    "flat": Flat,
    "ramp": Ramp,
    "step": Step,
    "stairs": Stairs,
    "gap": Gap,
    "side_slope": SideSlope,
    "beams": Beams,
    "pallets": Pallets,
    "rough": Rough,
    "picture": Picture,
    "mesh": Mesh,
}


def course_names() -> list[str]:
    """Names of the courses that `load_course` knows."""
    return sorted(path.stem for path in _COURSES.glob("*.toml"))


def load_course(source: str, seed: int | None = None) -> Course:
    """Load a named course, or a TOML file with fields of `Course` and tables `[[pieces]]`.

    Each piece has a `kind` and fields of that piece. Files that it names are relative to the TOML file.

    Args:
        source: the name, or the file.
        seed: replaces that of the file.

    Raises:
        InvalidValueError: for any other source.
        SettingsFileError: for an unreadable file and invalid fields.
    """
    named = _COURSES / f"{source}.toml"
    table = read_toml(named) if source in course_names() else read_named("course", source, course_names())
    folder = Path(source).parent
    rows = table.pop("pieces", [])
    if not isinstance(rows, list):
        raise SettingsFileError(f"{source}: pieces = {rows!r:.80}: must be a list of tables")
    pieces = tuple(_piece(row, f"{source}: pieces[{k}]", folder) for k, row in enumerate(rows))
    course = build(Course, table, source, Course((Flat(),)))
    try:
        course = dataclasses.replace(course, pieces=pieces)
    except InvalidValueError as error:
        raise SettingsFileError(f"{source}: {error}") from error
    return course if seed is None else dataclasses.replace(course, seed=seed)


def _piece(row: object, where: str, folder: Path) -> Piece:
    if not isinstance(row, dict):
        raise SettingsFileError(f"{where}: {row!r:.80} is not a table")
    kind = row.pop("kind", None)
    if not isinstance(kind, str) or kind not in _KINDS:
        raise SettingsFileError(f"{where}: kind = {kind!r:.80}: must be one of {', '.join(_KINDS)}")
    if isinstance(row.get("file"), str):
        row["file"] = str(folder / row["file"])
    return build(_KINDS[kind], row, where)
