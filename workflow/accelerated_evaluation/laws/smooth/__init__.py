"""Smooth laws.

The closing speed given lead speed and range, with parametric tails above smooth thresholds.
"""
