"""References: poses and twists over time that a controller follows."""
