# Snakemake's own `include:` leaves out the default target of what it includes.
workflow.include("workflow/Snakefile", overwrite_default_target=True)
