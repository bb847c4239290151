"""`trackslip reproduce`: the paper from its first run to its last figure."""

from experiments.options.reproduce import ReproduceConfig as Config

EXAMPLES = (
    ("the whole paper", "trackslip reproduce"),
    ("with other random numbers", "trackslip reproduce --seed 1 --out out/reproduce-1"),
    ("on another ground", "trackslip reproduce --ground.across 0.9 --scanner.noise 0.01"),
)


def run(config: Config) -> None:
    """Drive the grid, identify the laws, verify them in closed loop, store, report and print.

    This process and its helpers do all that is independent; helpers drive while the rest is being imported here.
    """
    from experiments.work.reproduce import run as work

    work(config)
