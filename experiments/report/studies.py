"""The tables of Monte-Carlo studies: coverage of intervals, checks of the drive estimator."""

from collections.abc import Sequence

from experiments.measuring.check import Check
from experiments.report.drive_checks import CHECKS_HEADER, checks_table
from experiments.report.formats import for_terminal, number
from experiments.report.laws import SYMBOLS
from experiments.report.terminal import print_table
from experiments.studies.drive_cases import EPSILON, D
from experiments.studies.drive_coverage import DriveStudy, SimulatedDrives
from experiments.studies.steady_coverage import SteadyCoverage
from trackslip.slip.families import FAMILIES


def print_steady_coverage(found: SteadyCoverage) -> None:
    """Print the shares of repeats that cover each parameter, with the values that samples were drawn with [SI]."""
    rows: list[tuple[str, ...]] = []
    for name, shares in found.laws.items():
        for k, (key, share) in enumerate(shares.items()):
            symbol = f"{SYMBOLS[key]} [{FAMILIES[name].parameters[key].unit or '-'}]"
            drawn, unknown = found.values[name][key], found.laws_errors_unknown[name][key]
            rows.append((name if k == 0 else "", symbol, f"{drawn:+.4f}", f"{share:.3f}", f"{unknown:.3f}"))
    title = f"Share of {found.repeats} repeats whose 95 % interval covers the parameter"
    print_table(title, ("law", "parameter", "drawn from", "errors known", "errors unknown"), rows)
    runs = found.runs
    title = f"Share of {runs.repeats} grids whose {runs.law} interval covers the value fitted to the true motion"
    rows = [(SYMBOLS[key], f"{runs.noise[key]:.3f}", f"{runs.interval95[key]:.3f}") for key in runs.noise]
    print_table(title, ("parameter", "noise alone", "95 % interval"), rows)
    bias = " and ".join(f"{SYMBOLS[key]} by {value:+.6f}" for key, value in runs.bias_by_lean.items())
    print(f"The true motion here is the plate's, which leans outwards with the robot. This changes {bias}.")


def print_drive_study(found: DriveStudy) -> None:
    """Print the checks of the drive estimator, and the laws of MuJoCo's own drives."""
    print_table(f"{found.repeats} drives in each case", CHECKS_HEADER, checks_table(found.checks))
    title = "MuJoCo's drives without noise, and steady circles"
    print_table(title, ("", "D [mm]", "epsilon [1e-3]"), _simulated_rows(found.simulated))
    print_failures(found.failures, found.checks)


def print_failures(failures: Sequence[str], checks: Sequence[Check]) -> None:
    """Print why fits failed, and how many checks hold."""
    for line in failures:
        print(f"a fit failed: {line}")
    print(f"{sum(check.holds for check in checks)} of {len(checks)} checks hold")


def _simulated_rows(found: SimulatedDrives) -> list[tuple[str, ...]]:
    lines = (
        ("steady circles of the same speeds", found.steady),
        ("steady circles, the paper's", found.paper),
        (f"mean of {found.drives} drives", found.mean),
        ("scatter between drives", found.scatter),
    )
    rows = [(what, *(number(1e3 * values[name], 3) for name in (D, EPSILON))) for what, values in lines]
    shares = (number(found.coverage_of_steady[name], 3) for name in (D, EPSILON))
    return for_terminal([*rows, ("coverage of the steady law", *shares)])
