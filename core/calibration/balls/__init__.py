"""Coloured balls in pictures: found, measured, told from what they are not."""
