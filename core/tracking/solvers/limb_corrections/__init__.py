"""Limbs that a solution has lost, mistaken for others or mirrored: found in the images, and put right."""
