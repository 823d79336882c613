"""What a scene is, how it moves, and the exact motion to compare with."""
