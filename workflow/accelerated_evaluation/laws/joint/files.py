"""Files of joint laws: a readable JSON format, which only this module writes and reads."""

import os

import numpy as np

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, require_format, write_json
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws.joint import JOINT_LAWS, Box, JointLaw

FORMAT = "accelerated-evaluation joint law"
VERSION = 1
CHANGE = "Fit the law again, or name a law file that this version wrote."


def write_joint_law(path: str | os.PathLike, law: JointLaw, description: str) -> None:
    """Write a joint law as JSON, atomically; `read_joint_law` returns a law with the same parameters.

    Parameters
    ----------
    path
        File to write.
    law
        The law.
    description
        Description of the records to which the law was fitted.
    """
    header = {"format": FORMAT, "version": VERSION, "kind": law.kind, "description": description}
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
