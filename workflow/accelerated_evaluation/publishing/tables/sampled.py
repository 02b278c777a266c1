"""Beyond the paper: the table of a slow vehicle compared with references."""

from accelerated_evaluation.publishing.published import result_table

# The ratios of the vehicle under test to the references.
compared_table = result_table("compared", digits=2)
