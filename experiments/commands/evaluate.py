"""`trackslip evaluate`: how far odometry by slip laws is off on a log."""

from experiments.options.evaluate import EvaluateConfig as Config

EXAMPLES = (
    ("a law and no compensation", "trackslip evaluate out/wander --law out/identify --law none"),
    ("on a robot's log", "trackslip evaluate log.csv --law out/mine --law none"),
    ("of two laws, on a ROS bag", "trackslip evaluate run.mcap --law out/mine:icr --law out/mine:turn_loss"),
)


def run(config: Config) -> None:
    """Evaluate the laws, store and print their errors."""
    from experiments.work.evaluate import run as work

    work(config)
