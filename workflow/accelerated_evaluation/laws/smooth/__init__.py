"""Smooth laws: the closing speed given lead speed and range, with tails above smooth thresholds."""
