"""MuJoCo as the rooms use it: batches of simulations, the states of their robots, and drawing."""
