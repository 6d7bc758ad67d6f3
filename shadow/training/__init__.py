"""Training: the loop, the optimiser, and the task of each network."""
