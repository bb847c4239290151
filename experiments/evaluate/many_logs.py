"""Several logs evaluated by one command: errors of all models in all logs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import degrees
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from experiments.common import style
from experiments.common.colours import GREY
from experiments.common.laws import law_cell, shown
from experiments.common.log_names import log_names
from experiments.common.manifest import command_line, make_manifest, origin
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.plain_json import plain, write_json
from experiments.common.results import MANIFEST_FILE, REPORT_FILE, SUMMARY_FILE, file_names
from experiments.common.run import Run
from experiments.common.table import MISSING, Cell, Table, number, significant
from experiments.evaluate.config import Config
from experiments.evaluate.evaluation import Evaluation, evaluated
from experiments.evaluate.models import known_geometry
from experiments.evaluate.page import Report
from experiments.evaluate.prediction import Prediction, winner
from trackslip.errors import require

_NOTE: Final = (
    "Median errors of all models in all logs, in position and heading. Mean ratio: geometric mean "
    "over the logs of a model's error, relative to the smallest in each log."
)
_QUANTITIES: Final = (("position", "m", 1.0, 3), ("heading", "°", degrees(1.0), 2))
"""Errors with their printed unit, factor from SI and decimals."""


@dataclass(frozen=True)
class ErrorMatrix:
    """Errors of models in logs, at the time or distance ahead that all of them reach."""

    evaluations: Mapping[str, Evaluation]
    """By the logs' names."""

    @cached_property
    def ahead(self) -> tuple[float, str]:
        """The time [s] or distance [m] ahead, with its unit."""
        every = [each for log in self.evaluations.values() for each in log.predictions]
        _, length, unit = winner(every)
        return length, unit

    @cached_property
    def models(self) -> dict[str, str]:
        """The models' names by label, in order."""
        return {
            each.model.label: each.model.name
            for log in self.evaluations.values()
            for each in log.predictions
        }

    def median(self, label: str, log: str, quantity: str) -> float:
        """Median error of a model in a log, in SI units; NaN if unknown."""
        for prediction in self.evaluations[log].predictions:
            if prediction.model.label == label:
                return _median(prediction, self.ahead, quantity)
        return float("nan")

    @cached_property
    def compared(self) -> str:
        """The error by which models are compared: that of positions, if all logs have them."""
        first = next(iter(self.models))
        medians = [self.median(first, log, "position") for log in self.evaluations]
        return "position" if np.isfinite(medians).all() else "heading"

    @cached_property
    def ratios(self) -> dict[str, float]:
        """Geometric mean over the logs of each model's error, relative to the smallest in the log;
        NaN for models that aren't in every log.
        """
        medians = np.array(
            [
                [self.median(label, log, self.compared) for log in self.evaluations]
                for label in self.models
            ]
        )  # (models, logs)
        relative = medians / np.nanmin(medians, axis=0)
        means = np.exp(np.log(relative).mean(axis=1))
        return dict(zip(self.models, means.tolist(), strict=True))

    @property
    def best(self) -> str:
        """Label of the model with the smallest mean ratio."""
        known = {label: ratio for label, ratio in self.ratios.items() if np.isfinite(ratio)}
        return min(known, key=lambda label: known[label])

    def best_in(self, log: str) -> str:
        """Label of the model with the smallest error in a log."""
        medians = {label: self.median(label, log, self.compared) for label in self.models}
        known = {label: error for label, error in medians.items() if np.isfinite(error)}
        return min(known, key=lambda label: known[label])

    @property
    def table(self) -> Table:
        """A row for each model, a column for each log; last, the best model of each log."""
        rows: list[tuple[str | Cell, ...]] = []
        for label, name in self.models.items():
            cell = law_cell(name, label == self.best, formula=False)
            cells = [self._errors(label, log) for log in self.evaluations]
            ratio = self.ratios[label]
            rows.append((replace(cell, name=label, text=label), *cells, significant(ratio)))
        rows.append(("best in the log", *map(self.best_in, self.evaluations), ""))
        length, unit = self.ahead
        header = ("model", *self.evaluations, "mean ratio")
        return Table(f"Median errors after {length:g} {unit}", header, rows, note=_NOTE)

    def _errors(self, label: str, log: str) -> str:
        """Errors of a model in a log, in position and heading as far as they are known."""
        texts = []
        for quantity, unit, factor, digits in _QUANTITIES:
            text = number(factor * self.median(label, log, quantity), digits, unit)
            if text != MISSING:
                texts.append(text.replace(" °", "°"))
        return " | ".join(texts) or MISSING

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json: errors by log and model."""
        length, unit = self.ahead
        errors = {
            log: {
                label: {quantity: self.median(label, log, quantity) for quantity, *_ in _QUANTITIES}
                for label in self.models
            }
            for log in self.evaluations
        }
        ahead = {"length": length, "unit": unit}
        return {"ahead": ahead, "median": errors, "mean_ratio": self.ratios, "best": self.best}


def _median(prediction: Prediction, ahead: tuple[float, str], quantity: str) -> float:
    """Median error of a prediction; NaN if unknown."""
    errors = prediction.ahead(*ahead)
    part = None if errors is None else getattr(errors, quantity)
    return float("nan") if part is None else float(part.median)


def run_all(config: Config) -> None:
    """Predict each log by all models, and compare, store and report."""
    for log in config.logs:
        require(log.suffix != ".toml", "logs", log, "a log: a data set is evaluated alone")
    names = log_names(config.logs)
    folders = file_names(names)
    known = known_geometry(config)
    evaluations: dict[str, Evaluation] = {}
    with Run(config) as run, run.progress("evaluation", 2 * len(names), "stages") as step:
        for name, log in zip(names, config.logs, strict=True):
            evaluations[name] = evaluated(config, log, known, run.watch, step)
        matrix = ErrorMatrix(evaluations)
        for name, log, folder in zip(names, config.logs, folders, strict=True):
            own = replace(config, logs=(log,), out=config.out / folder)
            _write_log(run, own, folder, evaluations[name])
        logs = [log for each in evaluations.values() for log in each.log.logs]
        manifest = run.manifest(**origin(logs))
        run.write(matrix.to_json(), manifest=manifest)
        _page(matrix, folders, manifest).write(run.folder, config.pdf)
    matrix.table.print()
    for name, evaluation in evaluations.items():
        for note in evaluation.notes:
            print(f"warning: {name}: {note}")
    print(f"{_heading(matrix)}.")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")


def _write_log(run: Run, config: Config, folder: str, evaluation: Evaluation) -> None:
    """Write the evaluation of one log to a folder of its own, as for that log alone."""
    place = run.folder / folder
    place.mkdir()
    manifest = make_manifest(run.command, config, run.wall, **origin(evaluation.log.logs))
    write_json(place / SUMMARY_FILE, plain(evaluation.summary()))
    write_json(place / MANIFEST_FILE, manifest)
    evaluation.write_paths(place, config.rrd)
    title = f"Predictions of “{config.logs[0].resolve().name}”"
    report = Report(title, "", evaluation.predictions, [], evaluation.fit, evaluation.notes)
    report.page(manifest, command_line("evaluate")).write(place, config.pdf)


def _heading(matrix: ErrorMatrix) -> str:
    """The best model over all logs, in one sentence."""
    length, unit = matrix.ahead
    ratio = matrix.ratios[matrix.best]
    of_best = [log for log in matrix.evaluations if matrix.best_in(log) == matrix.best]
    best = f"Best over all logs after {length:g} {unit}: {matrix.best}"
    if len(of_best) == len(matrix.evaluations):
        return f"{best}, smallest errors in each"
    count = f"{len(of_best)} of {len(matrix.evaluations)} logs"
    times = significant(ratio, digits=3)
    return f"{best}, smallest errors in {count}, on average {times} times the smallest"


def _page(matrix: ErrorMatrix, folders: Sequence[str], manifest: Mapping[str, Any]) -> Page:
    """The page on several logs, with links to the page of each."""
    links = [
        Markup('<a href="{}/{}">{}</a>').format(folder, REPORT_FILE, name)
        for folder, name in zip(folders, matrix.evaluations, strict=True)
    ]
    notes = [f"{name}: {note}" for name, each in matrix.evaluations.items() for note in each.notes]
    plot = Plot("errors_in_all_logs", partial(_panels, matrix), "Errors in all logs")
    sections = [
        Section("Models and logs", [matrix.table, plot]),
        Section("Reports of the logs", [Bullets(links)]),
    ]
    title = f"Predictions of {len(folders)} logs"
    answer = Answer(_heading(matrix), warnings=notes)
    return Page(title, command_line("evaluate"), manifest, sections, answer=answer)


@style.styled
def _panels(matrix: ErrorMatrix) -> style.Panels:
    """Median errors, a row for each log and a point for each model."""
    length, unit = matrix.ahead
    logs = list(matrix.evaluations)
    height = 1.6 + 0.32 * len(logs) + 0.1 * len(matrix.models)
    panels = []
    for quantity, sign, factor, _ in _QUANTITIES:
        label = f"median error after {length:g} {unit} [{sign}]"
        figure, axes = style.panel(quantity.capitalize(), label, "", height)
        for row in range(len(logs)):
            axes.axhline(row, color=GREY, lw=0.5, zorder=0)
        for rank, (model, name) in enumerate(matrix.models.items()):
            errors = [factor * matrix.median(model, log, quantity) for log in logs]
            marker = style.MARKERS[rank % len(style.MARKERS)]
            colour = shown(name).colour
            axes.plot(errors, range(len(logs)), marker, color=colour, label=model)
        axes.set_xscale("log")
        style.log_ticks(axes.xaxis)
        axes.set_yticks(range(len(logs)), logs)
        axes.set_ylim(len(logs) - 0.5, -0.5)
        style.legend_below(figure, axes.get_legend_handles_labels()[0], ncols=2)
        panels.append(figure)
    return tuple(panels)
