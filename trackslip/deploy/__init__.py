"""Identified laws for other programs: ros2_control's parameters, JSON, C and Python."""
