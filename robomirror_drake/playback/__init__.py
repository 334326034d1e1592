"""Results as moving pictures in meshcat."""
