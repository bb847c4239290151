"""`trackslip grid`: drive what isn't driven yet, gather, sum up."""

from experiments.options.grid import SweepConfig as Config

EXAMPLES = (
    ("the paper's 25 runs", "trackslip grid"),
    ("six runs of 20 s", "trackslip grid --radii 0.5 1 2 --speeds 0.1 0.2 --duration 20"),
    ("on a gravel slope", "trackslip grid --ground gravel --ground.slope 0.1 --ground.uphill 1.57"),
    ("with a noisier scanner", "trackslip grid --scanner.noise 0.01 --obstacles posts --out out/noisy"),
    ("a thousand runs", "trackslip grid --grounds stone ice --slope 0 0.05 --seeds 0 1 2 3 4 5 6 7 8 9"),
    ("over any option", "trackslip grid --vary scanner.noise=0.005,0.02 robot.half_gauge=0.15,0.2"),
    ("on a Dask cluster", "trackslip grid --sweep sweep.toml --executor dask://host:8786"),
)


def run(config: Config) -> None:
    """Drive, gather, store and print."""
    from experiments.work.grid import run as work

    work(config)
