"""Vehicles of the user's own: a Python class, a command or an FMU, run by workers and kept in a store."""
