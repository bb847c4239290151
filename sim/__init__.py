"""The simulated world: robots on MuJoCo grounds, their drives, and the laser range finder that watches them."""
