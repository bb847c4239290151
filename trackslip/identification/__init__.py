"""From runs to steady slip samples, and from samples to fitted slip laws with intervals, compared."""
