"""Printed numbers: names of `experiments.common.table`, for modules that still import them from here."""

from experiments.common.table import MISSING, number, pair, percent, significant, span, stages_text

__all__ = ["MISSING", "number", "pair", "percent", "significant", "span", "stages_text"]
