"""The table that compares the paper's results with the simulation's."""

from collections.abc import Sequence
from math import degrees

from experiments.common.table import MISSING, Table, number, pair
from experiments.simulate.grid_summary import GridSummary
from experiments.simulate.tracking import TrackingResult
from trackslip.identification.result import Identification
from trackslip.laws.exponential import PUBLISHED

_NOTE = (
    "In the laws, R is in metres; slips and their errors are dimensionless. A dash means that "
    "the paper gives no "
    "value. The last rows are position errors by controller and compensation."
)


def comparison_table(
    grid: GridSummary, result: Identification, tracking: Sequence[TrackingResult]
) -> Table:
    """A table with a row per quantity in the paper: slip laws, radii, localization, slip errors,
    tracking errors.
    """
    fits = result.comparison.laws
    exponential, icr = (
        fits["exponential"].values if "exponential" in fits else {},
        fits["icr_radius"].values,
    )
    radii, errors, spread, poses = (
        grid.radius,
        grid.slip_error,
        grid.speed_spread,
        grid.localization,
    )
    radius_error = None if radii.rms_vs_published is None else 100 * radii.rms_vs_published
    rows = [
        *(
            (
                f"slip law, {track} track",
                _formula(vars(PUBLISHED), track),
                _formula(exponential, track),
            )
            for track in ("outer", "inner")
        ),
        *(
            (
                f"radius driven, {commanded:g} m commanded",
                number(published, 2, "m"),
                number(observed, 2, "m"),
            )
            for commanded, observed, published in zip(
                radii.commanded, radii.observed, radii.published, strict=True
            )
        ),
        _row("radius error, rms", radius_error, unit="%", digits=2),
        _row("slip minus Eq. 11, rms", grid.slip_rms_vs_published),
        _row("  at the simulation's own radii", grid.slip_rms_vs_published_at_simulated_radii),
        _row(
            "spread over speeds, outer | inner", spread.outer, spread.inner, published="almost none"
        ),
        _row("offset of the ICRs, D", 1e3 * icr["offset"], unit="mm", digits=2),
        _row("error of the effective radius", 100 * icr["radius_error"], unit="%", digits=2),
        _row(
            "localization, rms x | y", 1e3 * poses.rmse_x, 1e3 * poses.rmse_y, unit="mm", digits=1
        ),
        _row("localization, rms heading", degrees(poses.rmse_heading), unit="deg", digits=2),
        _row("valid poses per second", poses.rate_hz, digits=1, published="at least 10"),
        _row("slip error std, outer | inner", errors.outer.std, errors.inner.std, digits=5),
        _row("slip error bias, outer | inner", errors.outer.bias, errors.inner.bias, digits=5),
        *(
            _tracking(
                "feedforward, final", "much better, Fig. 8", result, result.errors.final_position
            )
            for result in tracking
            if result.controller == "feedforward"
        ),
        *(
            _tracking(
                "Eq. 31 after 12 s", "better, Fig. 11", result, result.errors.rms_position_after_12s
            )
            for result in tracking
            if result.controller == "linear"
        ),
    ]
    return Table("Published | simulated", ("quantity", "published", "simulated"), rows, note=_NOTE)


def _row(
    name: str, *simulated: float | None, unit: str = "", digits: int = 4, published: str = MISSING
) -> tuple[str, ...]:
    """A row for a quantity, with its published value and its simulated value or pair of values."""
    return name, published, pair([number(value, digits) for value in simulated], unit)


def _formula(exponential: dict[str, float], track: str) -> str:
    """The exponential law of the outer or inner track; a dash if the runs don't determine it."""
    if not exponential:
        return MISSING
    return f"{exponential[f'alpha_{track}']:.3g} exp({exponential[f'beta_{track}']:.2f} R)"


def _tracking(name: str, published: str, result: TrackingResult, error: float) -> tuple[str, ...]:
    """A row for a run's position error [m]; the paper states it only for the published law, in
    words.
    """
    words = published if result.compensation == "published" else MISSING
    return _row(f"{name}, {result.compensation}", 1e3 * error, unit="mm", digits=1, published=words)
