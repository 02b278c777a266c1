"""Infrastructure of the workflow: configuration, dependencies of rules, locks and jobs."""
