"""The drives of the tracks: servos, motors and their limits."""
