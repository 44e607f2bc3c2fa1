"""An LED of Linux' LED class as a light for halfangle."""
