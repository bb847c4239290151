"""What commands say about a robot without motors."""

from sim.motors.motor import UNLIMITED, Drive


def print_motors(robot: str, drive: Drive) -> None:
    """Print the line on a robot without motors."""
    for line in without_motors(robot, drive):
        print(f"Note: {line}.")


def without_motors(robot: str, drive: Drive) -> list[str]:
    """The line on a robot, given by its name or file, whose torque nothing limits; none for a robot
    with motors.
    """
    if drive.strength(0.0) < UNLIMITED:
        return []
    return [
        f"{robot} has no motors: its torque is unlimited, and its top speed {drive.top_speed:g} "
        "m/s; `torque_limit` or [drive.motor] in the table [drive] of its file limits it"
    ]
