"""Table, beyond the paper, of the ratios of a slow vehicle to reference vehicles."""

from accelerated_evaluation.publishing.published import result_table

# The ratios of the vehicle under test to the references.
compared_table = result_table("compared", digits=2)
