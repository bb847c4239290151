"""Colours and names, the same in every figure and recording."""

from typing import Any

BLUE, ORANGE, GREEN, RED, BLACK = "#0072B2", "#C98200", "#009E73", "#C1272D", "#1a1a1a"
VERMILLION = "#D55E00"  # red on a viewer's dark background
GREY, SHADE = "#8a8a8a", "#efefef"  # lines and areas for comparison
_LOOKS: dict[str, tuple[str, Any, str]] = {
    "none": (RED, (0, (12, 1.5)), "no slip assumed"),
    "published": (BLACK, "--", "published law (Eq. 11)"),
    "constant": (GREY, (0, (6, 2)), "constant slip"),
    "exponential": ("#CC79A7", "-.", "exponential"),
    "exponential_speed": (ORANGE, (0, (6, 1.5, 1, 1.5, 1, 1.5)), "exponential with speed"),
    "power": (GREEN, (0, (3, 1.5)), "power of radius"),
    "hyperbola": ("#8C510A", (0, (4, 1.5, 1, 1.5)), "hyperbola"),
    "icr": ("#3A93C9", (0, (2, 1)), "constant ICR"),
    "icr_radius": (BLUE, "-", "constant ICR with ε"),
    "turn_loss": ("#A63D6F", (0, (8, 2, 2, 2)), "constant ICR with turn loss"),
    "icr_load": ("#2B7A78", (0, (10, 2, 2, 2, 2, 2)), "constant ICR with slip under load"),
    "icr_sides": ("#6A3D9A", (0, (2, 2.5)), "constant ICR, two-sided"),
    "online": ("#117733", (0, (5, 1)), "online"),
    "online_load": ("#4B6A1E", (0, (5, 1, 2, 1)), "online, with slip under load"),
    "online_cold": ("#999933", (0, (5, 1, 1, 1)), "online, from nothing"),
}
COLOURS = {name: colour for name, (colour, _, _) in _LOOKS.items()}
"""Colours of slip laws and compensations, after Okabe and Ito's palette. Each has a contrast of at least 3 : 1 against
the card behind it, on the light page and on the dark one, where the style sheet inverts figures."""
DASHES = {name: dashes for name, (_, dashes, _) in _LOOKS.items()}
"""Their line styles, all different, so that they can also be told apart without colour."""
LABELS = {name: label for name, (_, _, label) in _LOOKS.items()}
"""Their printed names."""
