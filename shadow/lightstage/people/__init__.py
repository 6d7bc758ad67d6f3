"""Clothed people, drawn at random: imports run generate -> accessories -> cloth -> body."""
