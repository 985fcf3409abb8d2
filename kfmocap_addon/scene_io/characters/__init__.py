"""Characters of others, as bodies: their skins, and what moves their bones."""
