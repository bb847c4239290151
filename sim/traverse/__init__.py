"""Tracked robots on courses, in batches: outcomes, flipper reflexes and the learning task."""
