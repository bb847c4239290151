"""The simulated world that options describe, and the runs that are driven in it."""
