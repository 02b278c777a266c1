"""Infrastructure of the workflow: the configuration, the dependencies of rules, locks and jobs."""
