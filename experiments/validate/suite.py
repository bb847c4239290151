"""Findings of a suite of checks against theory, and their page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from experiments.common.check import Check
from experiments.common.check_table import checks_table
from experiments.common.page import Block, Bullets, Page, Section
from experiments.common.table import Table


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
    remark: str = "Errors are the largest of their kind"
    """What the checked values are."""

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json."""
        return {"checks": [check.to_json() for check in self.checks], **self.summary}

    @property
    def verdict(self) -> str:
        """Number of checks that hold; empty without checks."""
        held = sum(check.holds for check in self.checks)
        return f"{held} of {len(self.checks)} checks hold" if self.checks else ""

    def print(self) -> None:
        """Print the tables and the verdict."""
        for table in (*self._checks(self.title), *self.tables):
            table.print()
        if self.verdict:
            print(self.verdict)

    def _checks(self, title: str) -> list[Table]:
        return [checks_table(title, self.checks)] if self.checks else []

    def page(self, manifest: Mapping[str, Any], command: str) -> Page:
        """Checks and figures."""
        verdict = f"{self.verdict}. {self.remark}; a value marked ! is out of its bound." if self.checks else None
        sections = [
            Section("In numbers", [verdict, *self._checks("Checks"), *self.tables]),
            *self.sections,
            Section("What this does not show", [Bullets(self.limits)]),
        ]
        return Page(self.title, command, manifest, sections, self.intro)
