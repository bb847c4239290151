"""Colours and names, the same in every figure and recording."""

from __future__ import annotations

BLUE, ORANGE, GREEN, RED, BLACK = "#0072B2", "#C98200", "#009E73", "#C1272D", "#1a1a1a"
VERMILLION = "#D55E00"
"""Red on a viewer's dark background."""
GREY, SHADE = "#8a8a8a", "#efefef"
"""Lines and areas for comparison."""
COLOURS = {
    "none": RED,
    "published": BLACK,
    "constant": GREY,
    "exponential": "#CC79A7",
    "exponential_speed": ORANGE,
    "power": GREEN,
    "hyperbola": "#8C510A",
    "icr": "#3A93C9",
    "icr_radius": BLUE,
    "icr_sides": "#6A3D9A",
    "online": "#117733",
    "online_cold": "#999933",
}
"""Colours of slip laws and compensations, after Okabe and Ito's palette. Each has a contrast of at least 3 : 1 against
the card behind it, on the light page and on the dark one, where the style sheet inverts figures."""
LABELS = {
    "none": "no slip assumed",
    "published": "published law (Eq. 11)",
    "constant": "constant slip",
    "exponential": "exponential",
    "exponential_speed": "exponential with speed",
    "power": "power of radius",
    "hyperbola": "hyperbola",
    "icr": "constant ICR",
    "icr_radius": "constant ICR with ε",
    "icr_sides": "constant ICR, two-sided",
    "online": "online",
    "online_cold": "online, from nothing",
}
"""Printed names of slip laws and compensations."""
