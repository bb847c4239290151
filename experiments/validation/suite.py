"""Findings of a suite of checks against theory, and their page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from experiments.checks import Check
from experiments.report.checks import checks_table
from experiments.report.page import Block, Bullets, Page, Section
from experiments.report.table import Table


@dataclass(frozen=True)
class Findings:
    """The checks of a suite and what is shown with them."""

    title: str
    intro: Sequence[Block]
    checks: Sequence[Check]
    tables: Sequence[Table]
    """More numbers."""
    sections: Sequence[Section]
    """Figures."""
    limits: Sequence[str]
    """Questions that the suite leaves open."""
    summary: Mapping[str, Any]
    """The content of summary.json besides the checks."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Entries of the manifest."""

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json."""
        return {"checks": [check.to_json() for check in self.checks], **self.summary}

    @property
    def verdict(self) -> str:
        """Number of checks that hold."""
        return f"{sum(check.holds for check in self.checks)} of {len(self.checks)} checks hold"

    def print(self) -> None:
        """Print the tables and the verdict."""
        for table in (checks_table(self.title, self.checks), *self.tables):
            table.print()
        print(self.verdict)

    def page(self, manifest: Mapping[str, Any], command: str) -> Page:
        """Checks and figures."""
        verdict = f"{self.verdict}. Errors are the largest of their kind; a value marked ! is out of its bound."
        sections = [
            Section("In numbers", [verdict, checks_table("Checks", self.checks), *self.tables]),
            *self.sections,
            Section("What this does not show", [Bullets(self.limits)]),
        ]
        return Page(self.title, command, manifest, sections, self.intro)
