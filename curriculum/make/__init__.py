"""Makes again what is made, of any chapter."""
