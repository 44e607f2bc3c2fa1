"""Few views: materials that a picture's interiors share, and normals as a smooth field."""
