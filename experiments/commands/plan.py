"""`trackslip plan`: the shortest experiment, and how well it does."""

from experiments.options.plan import PlanConfig as Config

EXAMPLES = (
    ("the best minute in 3 x 3 m", "trackslip plan --half-gauge 0.168 --sprocket-radius 0.06"),
    ("outdoors, with GNSS", "trackslip plan --half-gauge 0.3 --sprocket-radius 0.1 --area 12x8 --poses gnss"),
    ("where the law is least known", "trackslip plan --after out/identify --duration 30"),
    ("tried a hundred times", "trackslip plan --after out/identify --drive --repeats 100"),
)


def run(config: Config) -> None:
    """Plan, try, store and print."""
    from experiments.work.plan import run as work

    work(config)
