"""Networks: what is learned. Methods feed them and act on what they say."""
