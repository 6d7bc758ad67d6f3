"""Metrics, tables and figures that compare networks with path-traced ground truth."""
