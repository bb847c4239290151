"""The paper, from its runs to its report, shared out among processes."""
