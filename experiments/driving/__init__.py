"""From options to a simulated world and its runs."""
