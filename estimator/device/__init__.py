"""One device: its samples, and what is made of them."""
