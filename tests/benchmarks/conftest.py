"""Ratios of times measured side by side, their bounds, and the table of them at the end."""

import numpy as np
import pytest
from bare_engine import seconds

pytest.importorskip("pytest_benchmark")
ROUNDS = 5


@pytest.fixture
def within(benchmark, record_property):
    """A function that stores a ratio with its bound and fails where the bound is missed."""

    def check(ratio: float, *, least: float | None = None, most: float | None = None) -> None:
        if most is None:
            bound = f"at least {least:g}"
            is_within = ratio >= least
        else:
            bound = f"at most {most:g}"
            is_within = ratio <= most
        benchmark.extra_info.update(ratio=ratio, bound=bound)
        record_property("ratio", f"{ratio:.2f}, {bound}")
        assert is_within, f"{ratio:.2f} is not {bound}"

    return check


@pytest.fixture
def compare(benchmark, within):
    """A function that times `bare` and `ours` in turns, ours after `start`, and bounds the median
    ratio of speeds.

    The machine may be shared, and its clock rate may change: only times measured side by side are
    compared.
    """

    def run(ours, bare, least, start=lambda: None):
        times = []

        def setup():
            times.append(seconds(bare))
            start()

        benchmark.pedantic(ours, setup=setup, rounds=ROUNDS, warmup_rounds=1)
        if not benchmark.disabled:
            _, *bare_times = times  # the first is of the warm-up
            ratios = np.divide(bare_times, benchmark.stats.stats.data)
            within(float(np.median(ratios)), least=least)

    return run


def pytest_terminal_summary(terminalreporter):
    reports = [*terminalreporter.getreports("passed"), *terminalreporter.getreports("failed")]
    ratios = {report.nodeid: dict(report.user_properties).get("ratio") for report in reports}
    for node, ratio in ratios.items():
        _, _, name = node.rpartition("::test_")
        if ratio is not None:
            terminalreporter.write_line(f"{name:60} {ratio}")
