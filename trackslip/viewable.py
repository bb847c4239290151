"""Base classes of results: what a notebook shows of them, data frames, figures, and short text."""

from __future__ import annotations

import importlib
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from trackslip.errors import TrackslipError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FEW: Final = 3  # number of items up to which a collection is written out
_LONGEST: Final = 60  # length up to which the text of a value is written out [characters]


class Viewable:
    """Base class of results that notebooks, data frames and matplotlib show.

    Its methods import `trackslip.views` by name when they are called. So results don't depend on
    how they look, and `import trackslip` needs no plots.
    """

    def _repr_html_(self) -> str:
        """A small table with units and symbols, which notebooks show."""
        html: str = importlib.import_module("trackslip.views.summaries").html(self)
        return html

    def plot(self, figure: Figure | None = None) -> Figure:
        """Draw the result with matplotlib.

        Args:
            figure: an empty figure to draw into, such as `matplotlib.pyplot.figure()` for a window;
                by default a new one, which notebooks show and `savefig` writes.
        """
        drawn: Figure = importlib.import_module("trackslip.views.figures").plot(self, figure)
        return drawn

    def to_pandas(self) -> Any:
        """The result as a pandas data frame, in SI units.

        Any other library with Arrow's PyCapsule protocol reads the result itself, as in
        `polars.DataFrame(result)`, `pyarrow.table(result)` or `narwhals.from_arrow`.

        Raises:
            TrackslipError: if pandas is not installed.
        """
        table = importlib.import_module("trackslip.views.frames").table(self)
        try:
            return table.to_pandas()
        except ImportError as error:
            raise TrackslipError(
                "to_pandas: pandas is not installed; `pip install pandas`, or read the result with "
                "another library, as in polars.DataFrame(result)"
            ) from error

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """The table of `to_pandas` as an Arrow stream, for libraries that read Arrow's PyCapsule
        protocol.
        """
        table = importlib.import_module("trackslip.views.frames").table(self)
        return table.__arrow_c_stream__(requested_schema)


class ShortRepr:
    """Base class of dataclasses with large fields, which `repr` shows by their shapes and sizes.

    The dataclass is made with `repr=False`.
    """

    def __repr__(self) -> str:
        shown = [
            f"{field.name}={_short(getattr(self, field.name))}"
            for field in fields(self)  # type: ignore[arg-type]
        ]
        return f"{type(self).__name__}({', '.join(shown)})"


def _short(value: object) -> str:
    """The text of a value or, if that is long, of its type and size."""
    if isinstance(value, np.ndarray):
        return f"<array {value.shape}>"
    if isinstance(value, ShortRepr) or (is_dataclass(value) and not isinstance(value, type)):
        return f"<{type(value).__name__}>"
    if isinstance(value, Mapping) and len(value) > 0:
        items = [f"{key!r}: {_short(item)}" for key, item in [*value.items()][:_FEW]]
        return _with_rest("{", items, len(value), "}")
    if isinstance(value, Collection) and not isinstance(value, str | bytes):
        items = [_short(item) for item in [*value][:_FEW]]
        return _with_rest("[", items, len(value), "]")
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _with_rest(opening: str, items: list[str], count: int, closing: str) -> str:
    """The first items of a collection of `count`, and how many there are beyond them."""
    rest = [f"… {count - len(items):,} more"] if count > len(items) else []
    return f"{opening}{', '.join([*items, *rest])}{closing}"
