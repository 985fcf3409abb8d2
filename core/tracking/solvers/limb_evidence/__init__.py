"""What the images say about where a limb is: the pixels that it would cover, and the edges at its sides."""
