"""The paper's results beside the simulation's, quantity by quantity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees

from experiments.measuring.grid import GridSummary
from experiments.measuring.tracking import TrackingResult
from trackslip.slip.base import SlipLaw
from trackslip.slip.exponential import PUBLISHED, Exponential
from trackslip.slip.icr import ConstantIcr

Values = tuple[float | None, ...]


@dataclass(frozen=True)
class Quantity:
    """A quantity, with its published and its simulated value or pair of values."""

    name: str
    published: Values | str
    """In `unit`; in words where the paper gives no number, empty where it is silent."""
    simulated: Values | str
    unit: str = ""
    digits: int = 4
    """Decimals to print."""


def compare_with_paper(
    grid: GridSummary, laws: Mapping[str, SlipLaw], tracking: Sequence[TrackingResult]
) -> list[Quantity]:
    """Every quantity of the paper's experiments: slip laws, radii, localization, slip errors, tracking errors."""
    exponential, icr = laws.get("exponential"), laws.get("icr_radius")
    assert exponential is None or isinstance(exponential, Exponential)
    assert icr is None or isinstance(icr, ConstantIcr)
    errors, spread, poses = grid.slip_error, grid.speed_spread, grid.localization
    return [
        *(Quantity(f"slip law, {track} track", _formula(PUBLISHED, track), _formula(exponential, track))
          for track in ("outer", "inner")),
        *(Quantity(f"radius driven, {commanded:g} m commanded", (published,), (observed,), "m", 2)
          for commanded, observed, published in zip(
              grid.radius.commanded, grid.radius.observed, grid.radius.published, strict=True)),
        Quantity("radius error, rms", (), (_percent(grid.radius.rms_vs_published),), "%", 2),
        Quantity("slip minus Eq. 11, rms", (), (grid.slip_rms_vs_published,)),
        Quantity("  at the simulation's own radii", (), (grid.slip_rms_vs_published_at_simulated_radii,)),
        Quantity("spread over speeds, outer | inner", "almost none", (spread.outer, spread.inner)),
        Quantity("offset of the ICRs, D", (), (1e3 * icr.offset if icr else None,), "mm", 2),
        Quantity("error of the effective radius", (), (_percent(icr.radius_error) if icr else None,), "%", 2),
        Quantity("localization, rms x | y", (), (1e3 * poses.rmse_x, 1e3 * poses.rmse_y), "mm", 1),
        Quantity("localization, rms heading", (), (degrees(poses.rmse_heading),), "deg", 2),
        Quantity("valid poses per second", "at least 10", (poses.rate_hz,), "", 1),
        Quantity("slip error std, outer | inner", (), (errors.outer.std, errors.inner.std), "", 5),
        Quantity("slip error bias, outer | inner", (), (errors.outer.bias, errors.inner.bias), "", 5),
        *(_tracking("feedforward, final", "much better, Fig. 8", result, result.errors.final_position)
          for result in tracking if result.controller == "feedforward"),
        *(_tracking("Eq. 31 after 12 s", "better, Fig. 11", result, result.errors.rms_position_after_12s)
          for result in tracking if result.controller == "linear"),
    ]  # fmt: skip


def _formula(law: Exponential | None, track: str) -> str:
    """The exponential law of the outer or inner track; empty without a law."""
    if law is None:
        return ""
    return f"{getattr(law, f'alpha_{track}'):.3g} exp({getattr(law, f'beta_{track}'):.2f} R)"


def _tracking(name: str, published: str, result: TrackingResult, error: float) -> Quantity:
    """A position error [m] of a run with one compensation; only the published law's is in the paper, in words."""
    words = published if result.compensation == "published" else ()
    return Quantity(f"{name}, {result.compensation}", words, (1e3 * error,), "mm", 1)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share
