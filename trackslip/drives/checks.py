"""Verdicts of checks on logs: a check without evidence says so."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """The verdict of a check on a log."""

    HOLDS = "holds"
    FAILS = "fails"
    UNKNOWN = "can't be told from this log"


@dataclass(frozen=True)
class Check:
    """A check of a log, with its verdict."""

    subject: str  # what was checked, as a noun: clocks, units, direction of headings
    verdict: Verdict
    line: str = ""  # if it fails: the cause and a remedy; if unknown: why it can't be told
    # one word for an alarm if it fails; empty if the log can't be used
    alarm: str = ""

    @property
    def refuses(self) -> bool:
        """True if the log can't be used."""
        return self.verdict is Verdict.FAILS and not self.alarm


def unknown_lines(checks: Iterable[Check]) -> list[str]:
    """A line for each reason why checks can't be told, such as "headings and sides can't be
    checked: 10 poses, 33 s apart".
    """
    subjects = dict[str, list[str]]()
    for check in checks:
        if check.verdict is Verdict.UNKNOWN:
            subjects.setdefault(check.line, []).append(check.subject)
    return [f"{_listed(names)} can't be checked: {reason}" for reason, names in subjects.items()]


def _listed(names: list[str]) -> str:
    """Names as an enumeration in a sentence."""
    *others, last = dict.fromkeys(names)
    return f"{', '.join(others)} and {last}" if others else last
