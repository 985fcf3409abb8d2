"""How far from the truth the tracker ends, and how long it takes."""
