"""LED controllers by SCPI over USBTMC."""
