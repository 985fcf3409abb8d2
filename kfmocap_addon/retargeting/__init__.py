"""Motion put on other characters' rigs: reading a rig's controls, writing their curves, measuring what came of it."""
