"""Characters and props as bodies that are tracked themselves."""
