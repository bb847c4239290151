"""`trackslip predict`: slip from theory, without simulating."""

from experiments.options.predict import PredictConfig as Config

EXAMPLES = (
    ("the shipped robot", "trackslip predict"),
    ("uphill on ground that shears", "trackslip predict --shear 0.01 --slope 0.17"),
    ("a robot of another size", "trackslip predict --half-gauge 0.25 --contact-length 0.6 --friction-ratio 1.2"),
)


def run(config: Config) -> None:
    """Compute the slips, store and print them."""
    from experiments.work.predict import run as work

    work(config)
