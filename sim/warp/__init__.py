"""Fleets whose physics MuJoCo Warp steps, on a GPU."""
