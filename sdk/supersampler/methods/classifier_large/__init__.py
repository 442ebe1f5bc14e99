"""`classifier-large`: `classifier` with a history of 1.4 times the display's width and height."""
