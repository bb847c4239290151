"""The laser range finder and what it sees."""
