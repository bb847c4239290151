"""The table that compares the paper's results with the simulation's."""

from collections.abc import Sequence
from math import degrees
from typing import Final

from experiments.common.table import MISSING, Table, number, pair
from experiments.simulate.grid_summary import (
    ErrorStatistics,
    GridSummary,
    LocalizationErrors,
    OuterInner,
    RadiusSummary,
)
from experiments.simulate.tracking import TrackingResult
from trackslip.identification.result import Identification
from trackslip.laws.exponential import PUBLISHED

TableRow = tuple[str, str, str]
"""A quantity with its published and its simulated value."""
_NOTE: Final = (
    "In the laws, R is in metres; slips and their errors are dimensionless. A dash means that the "
    "paper gives no value. The last rows are position errors by controller and compensation."
)


def comparison_table(
    grid: GridSummary, result: Identification, tracking: Sequence[TrackingResult]
) -> Table:
    """A table with a row per quantity in the paper: slip laws, radii, localization, slip errors,
    tracking errors.
    """
    rows = [
        *_law_rows(result),
        *_radius_rows(grid.radius),
        *_slip_rows(grid),
        *_icr_rows(result),
        *_localization_rows(grid.localization),
        *_slip_error_rows(grid.slip_error),
        *_tracking_rows(tracking),
    ]
    return Table("Published | simulated", ("quantity", "published", "simulated"), rows, note=_NOTE)


def _law_rows(result: Identification) -> list[TableRow]:
    """The exponential law of each track; the runs may not determine it."""
    fits = result.comparison.laws
    published = vars(PUBLISHED)
    simulated = fits["exponential"].values if "exponential" in fits else {}
    return [
        (f"slip law, {track} track", _formula(published, track), _formula(simulated, track))
        for track in ("outer", "inner")
    ]


def _radius_rows(radii: RadiusSummary) -> list[TableRow]:
    """The radii driven, one row per commanded radius, and their error over all of them."""
    triples = zip(radii.commanded, radii.published, radii.observed, strict=True)
    rows = [
        (
            f"radius driven, {commanded:g} m commanded",
            number(published, 2, "m"),
            number(observed, 2, "m"),
        )
        for commanded, published, observed in triples
    ]
    error = None if radii.rms_vs_published is None else 100 * radii.rms_vs_published
    rows.append(_row("radius error, rms", error, unit="%", digits=2))
    return rows


def _slip_rows(grid: GridSummary) -> list[TableRow]:
    """Slip compared with the published law, and its spread over the speeds at a radius."""
    at_own_radii = grid.slip_rms_vs_published_at_simulated_radii
    spread = grid.speed_spread
    return [
        _row("slip minus Eq. 11, rms", grid.slip_rms_vs_published),
        _row("  at the simulation's own radii", at_own_radii),
        _row(
            "spread over speeds, outer | inner", spread.outer, spread.inner, published="almost none"
        ),
    ]


def _icr_rows(result: Identification) -> list[TableRow]:
    """The parameters of the law with two ICRs and an effective radius."""
    values = result.comparison.laws["icr_radius"].values
    offset_mm = 1e3 * values["offset"]
    radius_error_percent = 100 * values["radius_error"]
    return [
        _row("offset of the ICRs, D", offset_mm, unit="mm", digits=2),
        _row("error of the effective radius", radius_error_percent, unit="%", digits=2),
    ]


def _localization_rows(poses: LocalizationErrors) -> list[TableRow]:
    """Errors and rate of the poses estimated from scans."""
    x_mm = 1e3 * poses.rmse_x
    y_mm = 1e3 * poses.rmse_y
    heading = degrees(poses.rmse_heading)
    return [
        _row("localization, rms x | y", x_mm, y_mm, unit="mm", digits=1),
        _row("localization, rms heading", heading, unit="deg", digits=2),
        _row("valid poses per second", poses.rate_hz, digits=1, published="at least 10"),
    ]


def _slip_error_rows(errors: OuterInner[ErrorStatistics]) -> list[TableRow]:
    """Errors of the slips measured from scans."""
    outer = errors.outer
    inner = errors.inner
    return [
        _row("slip error std, outer | inner", outer.std, inner.std, digits=5),
        _row("slip error bias, outer | inner", outer.bias, inner.bias, digits=5),
    ]


def _tracking_rows(tracking: Sequence[TrackingResult]) -> list[TableRow]:
    """Position errors of both controllers: where feedforward ends, and what feedback leaves."""
    rows = []
    for run in tracking:
        if run.controller == "feedforward":
            error = run.errors.final_position
            rows.append(_tracking("feedforward, final", "much better, Fig. 8", run, error))
    for run in tracking:
        if run.controller == "linear":
            error = run.errors.rms_position_after_12s
            rows.append(_tracking("Eq. 31 after 12 s", "better, Fig. 11", run, error))
    return rows


def _row(
    name: str, *simulated: float | None, unit: str = "", digits: int = 4, published: str = MISSING
) -> TableRow:
    """A row for a quantity, with its published value and its simulated value or pair of values."""
    values = [number(value, digits) for value in simulated]
    return name, published, pair(values, unit)


def _formula(exponential: dict[str, float], track: str) -> str:
    """The exponential law of the outer or inner track; a dash if the runs don't determine it."""
    if not exponential:
        return MISSING
    alpha = exponential[f"alpha_{track}"]
    beta = exponential[f"beta_{track}"]
    return f"{alpha:.3g} exp({beta:.2f} R)"


def _tracking(name: str, published: str, result: TrackingResult, error: float) -> TableRow:
    """A row for a run's position error [m]; the paper states it only for the published law, in
    words.
    """
    words = published if result.compensation == "published" else MISSING
    quantity = f"{name}, {result.compensation}"
    return _row(quantity, 1e3 * error, unit="mm", digits=1, published=words)
