"""Figures and tables, drawn from finished results; nothing is simulated here."""
