"""Accessories of a dressed person: hair, hats, glasses, shoes, bags, hand-held objects and seats."""
