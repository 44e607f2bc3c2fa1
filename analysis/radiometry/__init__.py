"""From counts to radiance: darks, response, noise, HDR merge."""
