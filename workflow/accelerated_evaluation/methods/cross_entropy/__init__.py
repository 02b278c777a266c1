"""The Cross-Entropy search for accelerated distributions, which the three methods of the paper share."""
