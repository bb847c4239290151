"""The tables of Monte-Carlo studies: coverage of intervals, checks of the drive estimator."""

from collections.abc import Sequence

from experiments.measuring.check import Check
from experiments.report.checks import checks_table
from experiments.report.formats import number
from experiments.report.laws import SYMBOLS
from experiments.report.table import Table
from experiments.studies.drive_cases import EPSILON, D
from experiments.studies.drive_coverage import DriveStudy
from experiments.studies.steady_coverage import SteadyCoverage
from experiments.studies.trials import Coverage, sampling_error
from trackslip.slip.families import FAMILIES


def print_steady_coverage(found: SteadyCoverage) -> None:
    """Print the shares of repeats that cover each parameter, with the values that samples were drawn with [SI]."""
    rows: list[tuple[str, ...]] = []
    for name, shares in found.laws.items():
        for k, (key, share) in enumerate(shares.items()):
            symbol = f"{SYMBOLS[key]} [{FAMILIES[name].parameters[key].unit or '-'}]"
            both = (_share(one, found.repeats) for one in (share, found.laws_errors_unknown[name][key]))
            rows.append((name if k == 0 else "", symbol, f"{found.values[name][key]:+.4f}", *both))
    title = f"Share of {found.repeats} repeats whose 95 % interval covers the parameter"
    Table(title, ("law", "parameter", "drawn from", "errors known", "errors unknown"), rows, "lr").print()
    runs = found.runs
    rows = [
        (SYMBOLS[key], *(_share(one[key], runs.repeats) for one in (runs.noise, runs.interval95))) for key in runs.noise
    ]
    title = f"Share of {runs.repeats} grids whose {runs.law} interval covers the value fitted to the true motion"
    Table(title, ("parameter", "noise alone", "95 % interval"), rows).print()
    bias = " and ".join(f"{SYMBOLS[key]} by {value:+.6f}" for key, value in runs.bias_by_lean.items())
    print(f"The true motion here is the plate's, which leans outwards with the robot. This changes {bias}.")
    for check in found.checks:
        if not check.holds:
            print(f"does not hold: {check.to_json()['name']}")
    print_verdict(found.checks)


def print_drive_study(found: DriveStudy) -> None:
    """Print the checks of the drive estimator, and the laws of MuJoCo's own drives."""
    checks_table(f"{found.repeats} drives in each case", found.checks).print()
    lines = (
        ("steady circles of the same speeds", "steady", 1e3),
        ("steady circles, the paper's", "paper", 1e3),
        (f"mean of {found.drives} drives", "mean", 1e3),
        ("scatter between drives", "scatter", 1e3),
        ("coverage of the steady law", "coverage_of_steady", 1.0),
    )
    rows = [(text, *(number(scale * found.laws[law][name], 3) for name in (D, EPSILON))) for text, law, scale in lines]
    Table("MuJoCo's drives without noise, and steady circles", ("", "D [mm]", "epsilon [1e-3]"), rows).print()
    print(f"so many drives leave root mean squares uncertain by {sampling_error(found.repeats):.0%}")
    print_verdict(found.checks, found.failures)


def print_verdict(checks: Sequence[Check], failures: Sequence[str] = ()) -> None:
    """Print why fits failed, and how many checks hold."""
    for line in failures:
        print(f"a fit failed: {line}")
    print(f"{sum(check.holds for check in checks)} of {len(checks)} checks hold")


def _share(share: float, repeats: int) -> str:
    low, high = Coverage(round(share * repeats), repeats).interval95
    return f"{share:.3f} ({low:.2f} to {high:.2f})"
