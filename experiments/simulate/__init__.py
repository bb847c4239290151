"""The simulated world that options describe, and what drives in it."""
