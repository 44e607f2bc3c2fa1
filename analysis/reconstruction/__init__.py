"""From a registered stack to normals, depth and BRDF."""
