"""Published figures, one module for each subject."""
