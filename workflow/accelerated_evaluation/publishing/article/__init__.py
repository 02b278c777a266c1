"""The article of a study: its numbers, collected from the published tables, and the PDF."""
