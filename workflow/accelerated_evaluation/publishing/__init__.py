"""Figures, tables, book and archive, made from finished results; nothing is simulated in this package."""
