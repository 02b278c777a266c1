"""One probability over all laws that the records support: scores, weights, posterior and its checks."""
