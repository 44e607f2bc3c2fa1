"""Where the camera should go: patterns, nominal geometry and poses chosen for what they tell."""

from protocols.poses.patterns import Pose, repeated, ring

__all__ = ["Pose", "repeated", "ring"]
