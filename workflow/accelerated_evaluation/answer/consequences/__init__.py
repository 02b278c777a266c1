"""What follows from an answer: rates, injuries, motion of the lead vehicle, counted crashes and criteria."""
