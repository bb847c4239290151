"""`trackslip coverage`: do the 95 % intervals cover the truth in 95 % of many repeats?"""

from experiments.options.coverage import CoverageConfig as Config

EXAMPLES = (
    ("a thousand repeats", "trackslip coverage"),
    ("fewer", "trackslip coverage --repeats 100 --run-repeats 40 --grids 4"),
    ("laws from teleoperated drives", "trackslip coverage --drives"),
)


def run(config: Config) -> None:
    """Check the intervals of steady samples, or those of drives."""
    from experiments.work.coverage import run as work

    work(config)
