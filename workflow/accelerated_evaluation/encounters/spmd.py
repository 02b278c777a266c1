"""The real lane changes of the Safety Pilot Model Deployment, as the paper's authors published them."""

import hashlib
import io
import os
import zlib
from http.client import HTTPException
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pandas as pd
from scipy.io import loadmat
from scipy.io.matlab import MatReadError
from tqdm import tqdm

from accelerated_evaluation.encounters.reading import require_file
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.files import atomic_path

VARIABLE = "mixture_data"
COLUMNS = ("lead_speed", "inverse_range", "inverse_ttc")
# loadmat has no error of its own for a damaged file: truncated and altered copies were seen to raise these
DAMAGE = (MatReadError, OSError, ValueError, TypeError, IndexError, NotImplementedError, zlib.error)


def retrieve(url: str, sha256: str, path: str | os.PathLike, timeout: float = 60.0) -> None:
    """Download the published file with a progress bar; only a copy with the right checksum takes its name.

    Parameters
    ----------
    url
        Address of the file.
    sha256
        Checksum, 64 hexadecimal digits.
    path
        Where to put it.
    timeout
        Longest silence of the server [s].

    Raises
    ------
    InputError
        If the address cannot be read or the checksum differs; ``path`` is then left as it was.
    """
    with atomic_path(path) as temporary:
        try:
            _download(url, temporary, timeout)
        except (OSError, HTTPException) as error:  # URLError and time-outs are OSErrors
            raise InputError(
                url,
                seen=str(error),
                expected="a file to download",
                change=f"Check the connection and data.spmd.url, or put the file at {path} by hand.",
            ) from error
        _verify(temporary.read_bytes(), sha256, url)


def read(path: str | os.PathLike, sha256: str) -> pd.DataFrame:
    """Read the published MATLAB file.

    Parameters
    ----------
    path
        The .mat file: variable ``mixture_data``, shape (n, 3): v_L [m/s], R^-1 [1/m], TTC^-1 [1/s].
    sha256
        Its checksum, 64 hexadecimal digits.

    Returns
    -------
    pandas.DataFrame
        Columns ``lead_speed``, ``inverse_range``, ``inverse_ttc`` as in the file; index ``row`` from 1.

    Raises
    ------
    InputError
        If the file is missing, has another checksum, is damaged or holds something else.
    """
    require_file(path, "Run the retrieve step, or set data.spmd.path to a copy of the file.")
    content = Path(path).read_bytes()
    _verify(content, sha256, str(path))
    try:
        values = loadmat(io.BytesIO(content)).get(VARIABLE)
    except DAMAGE as error:
        raise _not_the_file(path, f"a damaged or truncated file ({error})") from error
    if values is None or values.dtype != np.float64 or values.shape[1:] != (len(COLUMNS),):
        seen = "no such variable" if values is None else f"shape {values.shape} of {values.dtype}"
        raise _not_the_file(path, f"{seen} in its place")
    return pd.DataFrame(values, columns=list(COLUMNS), index=pd.RangeIndex(1, len(values) + 1, name="row"))


def _download(url: str, path: Path, timeout: float) -> None:
    with urlopen(url, timeout=timeout) as response, path.open("wb") as file:
        size = int(response.headers.get("Content-Length", 0)) or None
        with tqdm(total=size, unit="B", unit_scale=True, desc="retrieve SPMD", disable=None) as bar:
            while chunk := response.read(1 << 16):
                file.write(chunk)
                bar.update(len(chunk))


def _verify(content: bytes, sha256: str, where: str) -> None:
    seen = hashlib.sha256(content).hexdigest()
    if seen != sha256.lower():
        raise InputError(
            where,
            seen=f"sha256 {seen} ({len(content):,} bytes)",
            expected=f"sha256 {sha256}",
            change="Retrieve the file again; if another one is meant, state its data.spmd.sha256.",
        )


def _not_the_file(path: str | os.PathLike, seen: str) -> InputError:
    return InputError(
        str(path),
        seen=seen,
        expected=f"variable {VARIABLE}, three columns of doubles: v_L [m/s], R^-1 [1/m], TTC^-1 [1/s]",
        change="Retrieve the file again.",
    )
