"""The networks: modules that take tensors and return tensors, and files that hold their weights."""
