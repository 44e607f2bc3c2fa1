"""LED drivers that speak a few words over a serial port."""
