"""Analysis: from raw counts to normals, depth and BRDF, offline."""
