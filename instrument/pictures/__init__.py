"""Single pictures as the counts that they hold: RAW, TIFF, PNG, JPEG, HEIC, BMP, EXR, HDR, PFM and NumPy files."""
