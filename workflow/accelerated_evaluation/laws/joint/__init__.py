"""Laws of any scenario: joint distributions of several named variables within limits."""

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.laws.joint.protocol import Box, JointLaw

# Kinds of joint laws, by the name that their files state; `JointLaw.fit` fits one to records.
JOINT_LAWS: Registry[type[JointLaw]] = Registry("joint law", __name__, __path__)

__all__ = ["JOINT_LAWS", "Box", "JointLaw"]
