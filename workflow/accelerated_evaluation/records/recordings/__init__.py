"""Extraction of cut-ins from recordings of traffic: the functions that several sources of raw data use."""
