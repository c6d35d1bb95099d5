"""Writes the scenes that come from formulas: see README.md."""
