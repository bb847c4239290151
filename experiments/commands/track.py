"""`trackslip track`: one run in closed loop."""

from experiments.options.track import TrackConfig as Config

EXAMPLES = (
    ("the paper's path and controller", "trackslip track"),
    ("without slip compensation", "trackslip track --compensation none --out out/track-none"),
    ("with online identification", "trackslip track --controller lqr --compensation online --reference slalom"),
    ("with your own laws", "trackslip track --laws out/identify --compensation exponential"),
)


def run(config: Config) -> None:
    """Drive once, store the run and print its errors."""
    from experiments.work.track import run as work

    work(config)
