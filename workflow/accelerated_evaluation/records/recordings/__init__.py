"""From recordings, frame by frame, to cut-ins: what the sources of raw data share."""
