"""The ground: friction, slope, patches, named grounds and ground files."""
