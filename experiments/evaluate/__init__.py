"""`trackslip evaluate`: measure how well laws and simulated robots predict a log."""
