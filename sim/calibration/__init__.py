"""Calibration: parameters of the simulated robot, fitted to data from a robot."""
