"""What chapters of the course zero2robot need beside their scripts: a package for each."""
