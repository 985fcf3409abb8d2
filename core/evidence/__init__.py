"""Evidence of the motion in the images."""
