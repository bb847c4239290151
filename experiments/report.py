"""One self-contained HTML page of a command's results: tables, figures as inline SVG, and how it was made."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments import figure_style, figures, tracking_figures
from experiments.page import MISSING, inline_svg, render_page
from trackslip.identification import FittedLaw, Identification, SlipSamples
from trackslip.metrics import rms
from trackslip.runlog import RunLog
from trackslip.slip import PUBLISHED, ConstantIcr

_TRACKING_COLUMNS = (
    ("rms_position", 1e3),
    ("rms_position_after_12s", 1e3),
    ("max_position", 1e3),
    ("final_position", 1e3),
    ("final_heading", math.degrees(1)),
)
"""Keys of a row of summary['tracking'] and the factor from SI to what is printed, mm and degrees."""
_PARAMETERS = {
    "alpha_outer": ("α outer", 1.0, ""),
    "beta_outer": ("β outer", 1.0, "1/m"),
    "alpha_inner": ("α inner", 1.0, ""),
    "beta_inner": ("β inner", 1.0, "1/m"),
    "offset": ("D", 1e3, "mm"),
    "radius_error": ("ε", 1e2, "%"),
}
"""Parameter of a law -> symbol, factor from SI, unit."""
_FORMULAS = {
    "exponential": ("α exp(β R)",),
    "icr": ("outer: D / (R + b + D)", "inner: −D / (R − b − D)"),
    "icr_radius": ("outer: 1 − (1 + ε)(R + b) / (R + b + D)", "inner: 1 − (1 + ε)(R − b) / (R − b − D)"),
}


@dataclass(frozen=True)
class ComparisonRow:
    """A row of the table published | simulated, as printed."""

    quantity: str
    published: str
    simulated: str


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a page shows. What is empty or None is left out of it."""

    title: str
    command: str
    """How it was made, in one line."""
    manifest: Mapping[str, Any]
    """Whatever fits into JSON: configuration, versions, seed."""
    summary: Mapping[str, Any]
    """Results as JSON; `tracking` is a list of TrackingErrors as mappings with controller and compensation [m, rad]."""
    comparison: Sequence[ComparisonRow] = ()
    grid_logs: Sequence[RunLog] = ()
    """Steady runs."""
    samples: SlipSamples | None = None
    identification: Identification | None = None
    tracking_logs: Sequence[RunLog] = ()
    """Runs along the paper's path, with `controller` and `compensation` in their metadata."""

    @property
    def laws(self) -> Mapping[str, FittedLaw]:
        """The fitted laws by name."""
        return {} if self.identification is None else self.identification.comparison.laws


@dataclass(frozen=True)
class LawRow:
    """A row of the table of laws, as printed."""

    name: str
    formula: tuple[str, ...]
    parameters: tuple[str, ...]
    rms: str


def render(report: Report) -> str:
    """The page as HTML that needs no other file."""
    drawn = {name: inline_svg(figure, name) for name, figure in _figures(report)}
    tracking = report.summary.get("tracking")
    return render_page(
        "report.html.j2",
        title=report.title,
        command=report.command,
        manifest=report.manifest,
        report=report,
        figures=drawn,
        conditions=_conditions(report),
        facts=_facts(report.samples),
        laws=_law_rows(report),
        half_gauge=_half_gauge(report.laws),
        tracking=_tracking_rows(tracking if isinstance(tracking, list | tuple) else ()),
        truth=any(log.truth is not None for log in report.tracking_logs),
    )


def _figures(report: Report) -> Iterator[tuple[str, Figure]]:
    """Name and figure of whatever the report has data for."""
    if report.grid_logs:
        yield "pose", figures.pose_and_velocity(figures.typical_run(report.grid_logs))
    if report.samples is not None and len(figures.RoleSamples.of(report.samples).radius):
        yield "slip", figures.slip_against_speed_and_radius(report.samples)
        if report.laws:
            yield "laws", figures.fitted_laws(report.samples, report.laws)
    feedforward = tracking_figures.runs_of(report.tracking_logs, "feedforward")
    linear = tracking_figures.runs_of(report.tracking_logs, "linear")
    if feedforward or linear:
        yield "plan", tracking_figures.planned_trajectory()
    if feedforward:
        yield "feedforward", tracking_figures.paths(feedforward)
    if linear:
        yield "linear", tracking_figures.paths(linear)
        yield "errors", tracking_figures.tracking_errors_over_time(linear)
        estimated = tracking_figures.slip_during_tracking(linear, report.laws)
        if estimated is not None:
            yield "estimated", estimated


def _facts(samples: SlipSamples | None) -> dict[str, str]:
    """Numbers for the captions: how many runs, their ranges, and how slip varies with speed at one radius."""
    if samples is None:
        return {}
    roles = figures.RoleSamples.of(samples)
    facts = {"runs": str(len(samples.run))}
    groups = [group for group in figures.alike(roles.radius) if len(group) > 1]
    if roles.radius.size:
        facts["radii"] = f"{roles.radius.min():.2f} to {roles.radius.max():.2f} m"
        facts["speeds"] = f"{roles.speed.min():.2f} to {roles.speed.max():.2f} m/s"
    if len(groups) > 1:
        for name, slip in (("inner", roles.inner), ("outer", roles.outer)):
            facts[name] = f"{max(float(np.ptp(slip[group])) for group in groups):.4f}"
    return facts


def _law_rows(report: Report) -> list[LawRow]:
    """The fitted laws, and the published one beside them where there are samples to hold it against."""
    rows = []
    for name, fit in report.laws.items():
        parameters = tuple(_parameter(key, fit.values[key], fit.stderr.get(key, math.nan)) for key in fit.values)
        label = figure_style.LABELS.get(name, name)
        rows.append(LawRow(label, _FORMULAS.get(name, (MISSING,)), parameters, f"{fit.rms:.4f}"))
    if report.laws and report.samples is not None:
        residual = rms(PUBLISHED(report.samples.curvature) - report.samples.slip)
        values = tuple(_parameter(key, value, 0.0) for key, value in vars(PUBLISHED).items())
        rows.append(LawRow(figure_style.LABELS["published"], _FORMULAS["exponential"], values, f"{residual:.4f}"))
    return rows


def _parameter(key: str, value: float, error: float) -> str:
    """`symbol = value ± standard error unit`, the error to two digits; an error of 0 stands for a printed value."""
    symbol, factor, unit = _PARAMETERS.get(key, (key, 1.0, ""))
    value, error = factor * value, factor * error
    if error == 0:
        text = f"{value:g}"
    elif math.isfinite(error):
        digits = max(0, 1 - math.floor(math.log10(error)))
        text = f"{value:.{digits}f} ± {error:.{digits}f}"
    else:
        text = f"{value:.4g} (error unknown)"
    text = text.replace("-", "−")
    return f"{symbol} = ({text}) {unit}" if unit and "±" in text else f"{symbol} = {text} {unit}".rstrip()


def _half_gauge(laws: Mapping[str, FittedLaw]) -> str | None:
    """b that the laws were fitted with, in metres."""
    known = (fit.law.half_gauge for fit in laws.values() if isinstance(fit.law, ConstantIcr))
    return next((f"{value:g} m" for value in known), None)


def _tracking_rows(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Controller, compensation, localization and the errors in mm and degrees, as printed."""
    printed = []
    for row in rows:
        names = [str(row.get(key, MISSING)) for key in ("controller", "compensation", "localization")]
        names[1] = figure_style.LABELS.get(names[1], names[1])
        printed.append([*names, *(_number(row.get(key), factor) for key, factor in _TRACKING_COLUMNS)])
    return printed


def _number(value: Any, factor: float) -> str:
    if not isinstance(value, int | float) or not math.isfinite(value):
        return MISSING
    return f"{factor * value:.1f}" if factor == 1e3 else f"{factor * value:.2f}"


def _conditions(report: Report) -> str:
    """Seed, ground and command in a line, as far as the manifest knows them."""
    parts = []
    seed, ground = _find(report.manifest, "seed"), _find(report.manifest, "ground")
    if seed is not None:
        parts.append(f"seed {seed}")
    if isinstance(ground, Mapping):
        parts.append("ground: " + ", ".join(f"{key} {value}" for key, value in ground.items() if value))
    elif ground is not None:
        parts.append(f"ground: {ground}")
    return " · ".join([*parts, report.command] if report.command else parts)


def _find(tree: Mapping[str, Any], key: str) -> Any:
    """The value of `key` nearest the root of nested mappings, or None."""
    if key in tree:
        return tree[key]
    inner = (_find(value, key) for value in tree.values() if isinstance(value, Mapping))
    return next((value for value in inner if value is not None), None)
