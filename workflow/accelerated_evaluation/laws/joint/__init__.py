"""Joint laws of the variables of a scenario, which can be fitted to any records within limits."""
