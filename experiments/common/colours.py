"""Colours for all figures and recordings."""

from typing import Final

BLUE: Final = "#0072B2"
ORANGE: Final = "#C98200"
GREEN: Final = "#009E73"
RED: Final = "#C1272D"
BLACK: Final = "#1a1a1a"
VERMILLION: Final = "#D55E00"  # red on a viewer's dark background
# lines and areas for comparison
GREY: Final = "#8a8a8a"
SHADE: Final = "#efefef"
