"""Learning tasks, and their environments for gymnasium."""
