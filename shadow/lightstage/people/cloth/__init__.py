"""Cloth: fabrics, patterns, draping, simulation, and the garments made of them."""
