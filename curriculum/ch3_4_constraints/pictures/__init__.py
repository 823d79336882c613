"""Pictures, and the script that makes them again."""
