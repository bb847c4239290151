"""Tracked robots that cross courses: N robots in a batch, how each run ends, and flippers moved by reflex."""
