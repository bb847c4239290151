"""`trackslip benchmark`: drive what isn't driven yet, gather, report."""

from experiments.options.benchmark import BenchmarkConfig as Config

EXAMPLES = (
    ("every controller on the paper's path", "trackslip benchmark"),
    ("Sec. IV of the paper", "trackslip benchmark --suite paper"),
    ("two controllers on ice", "trackslip benchmark --controllers linear lqr --grounds ice --seeds 0 1"),
    ("your own controller", "trackslip benchmark --controllers linear my_controller:MyController"),
)


def run(config: Config) -> None:
    """Drive, gather, store and print."""
    from experiments.work.benchmark import run as work

    work(config)
