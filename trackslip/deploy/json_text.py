"""A law as plain JSON, which `load_laws` also reads."""

from __future__ import annotations

import json
from typing import Any

from trackslip.deploy.facts import fact_lines, sensor_of, warnings_of
from trackslip.deploy.prediction import errors_of
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import laws_content
from trackslip.slip.nested import number, text, texts
from trackslip.slip.stored_laws import NO_SLIP, StoredLaws


def json_text(stored: StoredLaws, law: str) -> str:
    """JSON of one law; docs/ros.md describes its keys."""
    values = stored.values(law)
    intervals = {name: stored.interval95(law, name) for name in values}
    errors = {name: number(stored.content, "slip_laws", law, "stderr", name) for name in values}
    described = {law: {"values": values, "stderr": errors, "interval95": intervals}} if values else {}
    content: dict[str, Any] = {"law": law, "title": FAMILIES[law].title, "best": law}
    content |= laws_content(described, stored.geometry)
    content["units"] = {name: FAMILIES[law].parameters[name].unit or "-" for name in values}
    content["identified_from"] = {
        "file": stored.name,
        "arguments": texts(stored.manifest, "arguments"),
        "log": text(stored.manifest, "config", "path") or None,
        "created": text(stored.manifest, "created") or None,
        "trackslip": text(stored.manifest, "versions", "trackslip") or None,
        "method": text(stored.content, "method") or None,
        "drives": texts(stored.content, "drive", "drives"),
    }
    content["sensor"] = sensor_of(stored, law) or None
    content["prediction"] = {name: _errors(stored, name) for name in dict.fromkeys((NO_SLIP, law))}
    content["warnings"] = warnings_of(stored, law)
    content["comments"] = fact_lines(stored, law)
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _errors(stored: StoredLaws, law: str) -> list[dict[str, Any]]:
    return [{"what": error.what, "seconds_ahead": error.horizon, "rms": error.size} for error in errors_of(stored, law)]
