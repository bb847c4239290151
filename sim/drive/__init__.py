"""The drives of the tracks: servo, motor and their limits."""
