"""N robots on flat ground, stepped together, and the grounds under them."""
