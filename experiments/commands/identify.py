"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

from experiments.options.identify import IdentifyConfig as Config

EXAMPLES = (
    ("from a stored grid", "trackslip identify out/grid"),
    ("from a real robot's log", "trackslip identify log.csv --half-gauge 0.168 --sprocket-radius 0.06"),
    ("from a ROS bag", "trackslip identify run.mcap --half-gauge 0.168 --sprocket-radius 0.06"),
    ("from some runs of a sweep", "trackslip identify out/grid --where ground=ice seed=0"),
    ("from a drive, with a sensor 0.3 m ahead", "trackslip identify out/wander --method drive --sensor 0.3 0 0"),
    ("as in the paper", "trackslip identify out/grid --motion paper --out out/identify-paper"),
)


def run(config: Config) -> None:
    """Fit the laws, store and print them."""
    from experiments.work.identify import run as work

    work(config)
