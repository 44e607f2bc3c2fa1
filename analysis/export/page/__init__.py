"""A result as one HTML page that relights it by itself: what every pixel is made of, and a program that shades it."""
