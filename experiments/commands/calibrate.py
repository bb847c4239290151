"""`trackslip calibrate`: tune the simulated robot to published or measured slips and radii."""

from experiments.options.calibrate import CalibrateConfig as Config

EXAMPLES = (
    ("to the paper's slips and radii", "trackslip calibrate"),
    ("to a log, with other parameters", "trackslip calibrate --target log.csv --free friction_ratio radius_error"),
)


def run(config: Config) -> None:
    """Fit, store and print."""
    from experiments.work.calibrate import run as work

    work(config)
