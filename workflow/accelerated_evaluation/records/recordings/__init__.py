"""Extraction of cut-ins from recordings of traffic: the parts that the sources of raw data share."""
