"""`trackslip wander`: teleoperated drives, and logs of them as labs have."""

from experiments.options.wander import WanderConfig as Config

EXAMPLES = (
    ("two minutes of teleoperation, poses as from SLAM", "trackslip wander"),
    ("ten drives with GNSS", "trackslip wander --drives 10 --source gnss --out out/gnss"),
    ("a late clock and a jump", "trackslip wander --source.delay 0.15 --source.jumps 1 --source.jump-size 0.5"),
    ("a minute as a ROS 2 bag, with scans", "trackslip wander --duration 60 --source scanner --bag"),
    ("exactly by a law, to check an estimate", "trackslip wander --motion law --law.offset 0.04"),
)


def run(config: Config) -> None:
    """Drive, store and print."""
    from experiments.work.wander import run as work

    work(config)
