"""From the computer to the test track: scenario files, campaigns of real runs, sets of scenarios."""
