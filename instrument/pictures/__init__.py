"""Single pictures: RAW, TIFF, PNG, JPEG, EXR and NumPy files as the counts that they hold."""
