"""Built-in vehicles, simulated by compiled code: the car of the study, reference drivers, a human driver."""
