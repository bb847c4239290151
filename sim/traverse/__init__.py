"""Tracked robots crossing courses in a batch: outcomes, flipper reflexes and the learning task."""
