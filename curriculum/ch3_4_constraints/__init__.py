"""Chapter 3.4: rods that hold, and the forces that make them."""
