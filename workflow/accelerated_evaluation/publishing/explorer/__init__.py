"""The explorer: one page without a server, on which a reader changes the vehicle and sees the answer."""
