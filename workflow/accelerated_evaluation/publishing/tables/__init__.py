"""Published tables, one module for each subject."""
