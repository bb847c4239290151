"""The paper's runs, shared out among the copies of a process."""
