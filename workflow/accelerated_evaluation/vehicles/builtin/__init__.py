"""The car of the study and the reference drivers, compiled."""
