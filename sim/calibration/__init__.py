"""The robot's parameters fitted to slips and radii."""
