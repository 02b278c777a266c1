"""Smooth laws of the closing speed given lead speed and range, with parametric tails."""
