"""The page of a scene: what Python found, and its schemes to be touched."""
