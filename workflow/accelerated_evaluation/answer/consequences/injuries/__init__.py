"""Injuries of the two drivers in a crash, from published curves of the risk of injury."""
