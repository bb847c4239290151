"""Calibration: parameters of the simulated robot fitted to what a robot did."""
