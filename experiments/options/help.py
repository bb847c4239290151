"""Text of `--help` for options that are None by default."""

import tyro


def default_is(text: str, metavar: str) -> object:
    """Annotation of an option that is None by default: what `--help` prints as its default, and for its value."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {text})")
