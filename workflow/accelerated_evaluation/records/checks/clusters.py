"""Check of the number of clusters, such as drivers or devices, in records that name them."""

from accelerated_evaluation.base.tables import CLUSTER
from accelerated_evaluation.records.checks import CHECKS, FINE, WARNING, Finding, Records, needs

FEW_CLUSTERS = 20  # effective number of clusters below which bootstrap intervals over clusters are too short


@CHECKS.add("clusters")
@needs(CLUSTER)
def clusters(records: Records) -> Finding:
    """Check by their effective number, n² / Σ n_k², whether the records belong to enough clusters."""
    sizes = records.fitted[CLUSTER].value_counts().to_numpy(float)
    effective = float(sizes.sum() ** 2 / (sizes**2).sum()) if sizes.size else 0.0
    return Finding(
        WARNING if effective < FEW_CLUSTERS else FINE,
        "clusters, such as drivers or devices, that share the fitted records",
        f"{sizes.size:,} clusters, equivalent to {effective:.1f} of equal size",
        effective,
        "The records of one cluster are similar, so a few clusters contain little information about other "
        "clusters. Expect wide intervals. Records of more clusters reduce them most.",
    )
