"""From chunks to dense blocks, to a method, and back."""
