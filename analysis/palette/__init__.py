"""The few materials that a scene's pixels share."""
