"""Imported by the process that others are copied from: compiles what they need, once."""

from drivers.simulated.world import World
from tests.campaigns.small_rig import rig_config

World.from_rig(rig_config().model_dump(exclude_none=True)).picture()
