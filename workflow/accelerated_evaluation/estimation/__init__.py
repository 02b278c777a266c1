"""Estimates of the crash probability, their intervals, and when to stop."""
