"""Laws for any scenario: joint distributions of several named variables within limits."""

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.laws.joint.protocol import Box, JointLaw

# Classes of joint laws, by the name in law files; `JointLaw.fit` fits a law to records.
JOINT_LAWS: Registry[type[JointLaw]] = Registry("joint law", __name__, __path__)

__all__ = ["JOINT_LAWS", "Box", "JointLaw"]
