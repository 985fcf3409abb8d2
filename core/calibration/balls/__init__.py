"""Coloured balls in pictures: finding and measuring them, and rejecting what only looks like one."""
