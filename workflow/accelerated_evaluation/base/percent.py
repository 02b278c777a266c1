"""Shares in percent, as all texts write them."""


def in_percent(share: float, decimals: int = 0) -> str:
    """Return a share in percent, such as 12 %, which is rounded to 0 or 100 only if it is 0 or 1."""
    written, step = f"{100 * share:,.{decimals}f}", 10.0**-decimals
    if 0 < share < 1 and float(written) in (0, 100):
        return f"less than {step:g} %" if share < 0.5 else f"more than {100 - step:g} %"
    return f"{written} %"
