"""Accelerated distributions f*: what is drawn instead of f, and how it is searched."""
