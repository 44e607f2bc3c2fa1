"""Views resampled onto the plane of the sample: the registered stack."""
