"""Which bones of a human skeleton play which roles: by name, by position, or by a preset."""
