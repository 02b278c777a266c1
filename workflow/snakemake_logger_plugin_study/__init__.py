"""The console of the study: a line for each finished job, what is running, and an error's message last.

Snakemake finds this package by its name; ``logger: study`` in profiles/default chooses it.
"""

from snakemake_logger_plugin_study.console import LogHandler

__all__ = ["LogHandler"]
