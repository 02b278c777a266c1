"""Files of joint laws: a readable JSON format, which only this module writes and reads."""

import os
from collections.abc import Iterable

import numpy as np

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, require_format, write_json
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws.joint import JOINT_LAWS, Box, JointLaw
from accelerated_evaluation.records.verdict import Verdict

FORMAT = "accelerated-evaluation joint law"
VERSION = 1
NOT_CHECKED = {"stops": {}, "warnings": ["no verdict on the records in the file of the law"], "advice": {}}
CHANGE = "Fit the law again, or name a law file that this version wrote."


def write_joint_law(
    path: str | os.PathLike, law: JointLaw, description: str, verdict: Verdict | None = None
) -> None:
    """Write a joint law as JSON, atomically; `read_joint_law` returns a law with the same parameters.

    Parameters
    ----------
    path
        File to write.
    law
        The law.
    description
        Description of the records to which the law was fitted.
    verdict
        The verdict on these records, which `read_verdict` returns; None if they were not checked.
    """
    header = {"format": FORMAT, "version": VERSION, "kind": law.kind, "description": description}
    header |= {} if verdict is None else {"verdict": verdict.content()}
    write_json(path, header | {"variables": law.box.content()} | law.content())


def read_joint_law(path: str | os.PathLike, box: Box | None = None) -> JointLaw:
    """Return the joint law that a file describes.

    Parameters
    ----------
    path
        The file.
    box
        The variables and limits that the law must have; by default they are not checked.

    Raises
    ------
    InputError
        If the file is missing, is not a law of this version, or has other variables or limits.
    """
    require_file(path, CHANGE)
    try:
        content = read_json(path)
        require_format(path, content, FORMAT, VERSION, CHANGE)
        own = Box.from_content(content["variables"])
        law = JOINT_LAWS[content["kind"]].from_content(content, own)
        middle = np.mean([own.lower, own.upper], axis=0)[None]
        if not np.isfinite(law.from_normal_scores(np.zeros((1, own.dimension)))).all():
            raise ValueError("parameters that give no point of the law")
        if np.isnan(law.log_density(middle)).any():
            raise ValueError("parameters that give no density")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        seen = f"{type(error).__name__}: {error}"
        raise InputError(
            str(path), seen=seen, expected="a complete file of a joint law", change=CHANGE
        ) from error
    if box is not None and own != box:
        raise InputError(
            f"{path}, the variables",
            seen=str(own.content()),
            expected=str(box.content()),
            change="Name a law of this scenario, or fit the law again within these limits.",
        )
    return law


def read_verdict(path: str | os.PathLike, accepted: Iterable[str] = ()) -> Verdict:
    """Return the verdict on the records of a joint law, which its file contains.

    Parameters
    ----------
    path
        The file; `read_joint_law` checks the rest of it.
    accepted
        Names of the checks that the user accepts.

    Raises
    ------
    InputError
        If the file or its verdict cannot be read, or if a check has the verdict ``stop`` and ``accepted``
        does not name it.
    """
    require_file(path, CHANGE)
    try:
        content = read_json(path)
        require_format(path, content, FORMAT, VERSION, CHANGE)
        verdict = Verdict.from_content(content.get("verdict", NOT_CHECKED), accepted)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        seen = f"{type(error).__name__}: {error}"
        raise InputError(
            f"{path}, verdict", seen=seen, expected="a verdict on records", change=CHANGE
        ) from error
    verdict.require_accepted(str(path))
    return verdict
