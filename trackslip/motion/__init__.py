"""From poses over time to the body twist."""
