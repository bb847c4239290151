"""Checks of a suite: their table is printed, and none may fail."""

from collections.abc import Sequence

from experiments.common.check import Check, checks_table


def report(title: str, checks: Sequence[Check]) -> None:
    """Print the table of some checks and assert that all of them hold."""
    checks_table(title, checks).print()
    assert [str(check) for check in checks if not check.holds] == []
