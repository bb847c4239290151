"""`trackslip validate`: compare the simulator with theory."""

from experiments.options.validate import ValidateConfig as Config

EXAMPLES = (
    ("the shipped robot", "trackslip validate"),
    ("a calibrated robot", "trackslip validate --robot out/calibrate/robot.toml"),
    ("tracks on terrain", "trackslip validate --terrain"),
    ("ground that shears", "trackslip validate --shear"),
)


def run(config: Config) -> None:
    """Compare the shipped robot with theory, or tracks on terrain, or ground that shears."""
    from experiments.work.validate import run as work

    work(config)
