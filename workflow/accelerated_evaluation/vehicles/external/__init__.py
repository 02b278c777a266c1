"""Users' own vehicles: a Python class, a command or an FMU, run by workers, with stored outcomes."""
