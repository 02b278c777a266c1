"""Accelerated evaluation of automated vehicles: from lane-change records to a crash probability."""
