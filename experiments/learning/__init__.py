"""Training of policies: environments, tasks, and evaluation."""
