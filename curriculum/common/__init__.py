"""What every chapter shares."""
