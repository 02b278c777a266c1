"""Ways to the answer: from a map, scans, a few runs or near misses, and what checks each of them."""
