"""Colours for all figures and recordings."""

BLUE, ORANGE, GREEN, RED, BLACK = "#0072B2", "#C98200", "#009E73", "#C1272D", "#1a1a1a"
VERMILLION = "#D55E00"  # red on a viewer's dark background
GREY, SHADE = "#8a8a8a", "#efefef"  # lines and areas for comparison
