"""What drivers of stages share: settings of an axis, and waiting for its motion."""
