"""The state of a sampler as JSON, and back."""

import os
from typing import Any

import numpy as np

from accelerated_evaluation.files import read_json


def read_state(path: str | os.PathLike) -> Any:  # noqa: ANN401
    """Return the content of a state file; None if it is no JSON."""
    try:
        return read_json(path)
    except ValueError:
        return None


def plain(value: Any) -> Any:  # noqa: ANN401
    """Return the value with lists and Python's numbers in place of NumPy's."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def arrays(value: Any) -> Any:  # noqa: ANN401
    """Return the value with arrays in place of lists."""
    if isinstance(value, dict):
        return {key: arrays(item) for key, item in value.items()}
    return np.array(value) if isinstance(value, list) else value
