"""The workflow's own plumbing: configuration, what a rule depends on, locks and jobs."""
