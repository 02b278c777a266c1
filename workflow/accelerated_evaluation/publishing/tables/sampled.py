"""Beyond the paper: the table of a slow vehicle compared with references."""

import pandas as pd

from accelerated_evaluation.publishing.published import table


@table("compared", digits=2)
def compared_table(compared: pd.DataFrame) -> pd.DataFrame:
    """Return the ratios of the vehicle under test to the references in the published form."""
    return compared
