"""The ground: friction, slope, patches, names and files."""
