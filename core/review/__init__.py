"""Review: how far a tracked motion can be relied on, and where one more key pose would help most."""
