"""The page of a validation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from experiments.validation.results import Validation


def render(found: Validation, summary: Mapping[str, Any], manifest: Mapping[str, Any], command: str) -> str:
    """The page as HTML that needs no other file."""
    return "<!DOCTYPE html>"
