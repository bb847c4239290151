"""Powers of ten at logarithmic axes, as plain text: matplotlib's formulas take a tenth of the time of all figures."""

import re

from matplotlib.axis import Axis
from matplotlib.ticker import LogFormatterSciNotation, NullFormatter

_FORMULA = re.compile(r"\$\\mathdefault\{(.*)\}\$")
_EXPONENT = re.compile(r"\^\{(.*?)\}")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class PlainPowers(LogFormatterSciNotation):
    """Labels the ticks that matplotlib would label, and as it would."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of a tick at `x`, such as 2×10⁻³."""
        return plain(super().__call__(x, pos))


def plain(formula: str) -> str:
    """The text of a formula that has no more than powers and signs in it."""
    text = _FORMULA.sub(r"\1", formula).replace(r"\times", "×")
    return _EXPONENT.sub(lambda exponent: exponent[1].translate(_RAISED), text).replace("-", "−")


def print_plain_powers(axis: Axis) -> None:
    """Let a logarithmic axis, or a symmetrical one, have labels of plain text."""
    axis.set_major_formatter(PlainPowers())
    if not isinstance(axis.get_minor_formatter(), NullFormatter):
        axis.set_minor_formatter(PlainPowers())
